#pragma once

#include "mapp/base/status.h"
#include "mapp/view/seen_geometry.h"
#include "server/service/overlap_assessor.h"
#include "server/service/service_types.h"
#include "server/service/tile_cache.h"

#include <span>
#include <vector>

namespace mapp {

/// Thresholds of the geometric comparison.
struct UpdateOptions {
  /// Map points below this probability of being there are no evidence.
  float min_confidence = 0.5F;
  /// When a view shows that a place is free: rays that end before it hide it, a car before a wall removes no wall.
  SightingOptions sighting;
  /// Neighbours of a missing point that are asked whether they are missing too (K of the paper), and how many must be.
  size_t num_neighbors = 8;
  double min_missing_neighbor_ratio = 0.6;
  /// UPDATING needs both: so many points, and this share of those that should have been seen.
  size_t min_missing_points = 20;
  double min_missing_ratio = 0.1;
  /// EXPANSION from this share of own points that the map does not hold.
  double min_new_ratio = 0.5;
  /// Missing points nearer than this to each other share a box.
  float box_gap_m = 0.5F;
};

/// A keyframe as the device sent it and where it lies in the map.
struct ReportedKeyframe {
  MapView view;
  Keyframe keyframe;
};

/// Compares keyframes with the map where they look (DESIGN 10): a map point that should be visible (in the image and in
/// range, seen from a like direction, the ray to it free) with no own point near it in any keyframe, and whose nearest
/// neighbours are missing as well, is evidence of change. It rests on geometry alone: a point that the detector merely
/// did not pick counts as present as long as something was detected near it.
StatusOr<UpdateResult> CompareWithMap(TileCache& tiles, std::span<const ReportedKeyframe> keyframes,
                                      const UpdateOptions& options);

}  // namespace mapp
