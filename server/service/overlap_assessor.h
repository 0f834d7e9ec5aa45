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

  ViewCone Cone() const { return {T_map_camera, range_m, camera.FieldOfView()}; }
};

/// Which sample points of the view are REDUNDANT (DESIGN 5), in the order in which both sides derive them. May hold
/// fewer than `num_samples`: an empty sketch has none. Loads the tiles it needs.
/// `query.T_frame_camera` is not read: `view` has the pose in the map.
StatusOr<std::vector<bool>> AssessSamples(TileCache& tiles, const MapView& view, const ViewQuery& query,
                                          int num_samples);

}  // namespace mapp
