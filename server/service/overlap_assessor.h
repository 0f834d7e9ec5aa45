#pragma once

#include "mapp/base/status.h"
#include "mapp/codec/query_codec.h"
#include "mapp/view/view_cone.h"
#include "server/service/tile_cache.h"

#include <vector>

namespace mapp {

/// A view in a map, as every question about one starts.
struct MapView {
  MapId map;
  Pose3 T_map_camera;
  Camera camera;
  double range_m = kDefaultConeRangeM;  ///< h of the map
  int num_levels = kPyramidLevels;      ///< of the pyramid of the map's features

  ViewCone Cone() const { return {T_map_camera, range_m, camera.FieldOfView()}; }
};

/// What the map knows of the view (DESIGN 5), by the query's sampler: which sample points are REDUNDANT (there may be
/// fewer than `num_samples`: an empty sketch has none), or which bins hold neighbour points that were seen alike. Loads
/// the tiles it needs. `query.T_frame_camera` is not read: `view` has the pose in the map.
StatusOr<OverlapAnswer> AssessView(TileCache& tiles, const MapView& view, const ViewQuery& query, int num_samples);

/// How finely the view of a camera is divided: columns of about 0.04 on the plane z = 1, bins of 5.4 % of depth.
OccupancyResolution ResolutionFor(const Camera& camera);

/// The occupied bins at a given resolution.
StatusOr<OccupancyGrid> AssessBins(TileCache& tiles, const MapView& view, const DepthSketch& sketch,
                                   OccupancyResolution resolution);

}  // namespace mapp
