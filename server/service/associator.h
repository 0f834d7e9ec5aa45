#pragma once

#include "mapp/map/keyframe.h"
#include "server/service/keyframe_evidence.h"
#include "server/service/loaded_tile.h"
#include "server/service/overlap_assessor.h"

#include <memory>
#include <span>
#include <unordered_map>
#include <vector>

namespace mapp {

struct AssociationOptions {
  /// Search radius around a point's projection. Covers the pose error left after alignment: 2 cm and half a degree at
  /// 2 m and a focal length of 525 px are 7 px.
  double radius_px = 8;
  /// Hamming distance; between the strict 50 and the loose 100 of Mur-Artal et al. 2015, since place and depth have to
  /// agree as well.
  int max_distance = 64;
  double max_descriptor_ratio = 0.8;
  /// Depths agree when they differ by less than the greater of these.
  double max_depth_error_m = 0.05;
  double max_depth_error_ratio = 0.05;
  /// Greatest angle between the ray and the point's mean viewing direction.
  double max_view_angle_deg = 60;
};

/// Feature of a keyframe that shows a point the map holds already.
struct Association {
  size_t feature_idx = 0;
  MapPointId point;
};

struct Associations {
  std::vector<Association> found;
  /// With the points that other sessions than the keyframe's have seen.
  MapComparison comparison;
};

/// Finds, for the features named in `feature_idxs` (which must have a depth), the points of `tiles` that they show:
/// projection, octave, descriptor, viewing direction and depth have to agree (DESIGN 7). Points in `taken`, given with
/// the feature that names them, are left out. No feature and no point appears twice.
Associations AssociateFeatures(const MapView& view, const Keyframe& keyframe, std::span<const size_t> feature_idxs,
                               std::span<const std::shared_ptr<const LoadedTile>> tiles,
                               const std::unordered_map<MapPointId, size_t>& taken, const AssociationOptions& options);

}  // namespace mapp
