#pragma once

#include "mapp/client/map_client.h"
#include "mapp/client/shared_map.h"
#include "mapp/map/tile.h"
#include "mapp/view/view_cone.h"

#include <map>
#include <memory>
#include <vector>

namespace mapp {

/// The tiles a device has received, kept in memory so that each is sent once per revision. One thread only.
class SharedTiles {
 public:
  /// Beyond `max_tiles` those farthest from the latest view are dropped.
  SharedTiles(double tile_edge_m, size_t max_tiles, const Camera& camera)
      : grid_{.edge_m = tile_edge_m}, max_tiles_(max_tiles), focal_px_(camera.MeanFocalPx()) {}

  std::vector<ClientHeldTile> Held() const;
  /// Drops what is older than the revision that changed it. Tiles that are still there come anew with the next request;
  /// those that have lost all their points never would.
  void Forget(const std::map<TileKey, Revision>& changed);
  /// Newly received tiles, which replace older ones.
  void Put(std::vector<Tile> tiles);
  /// All points of the tiles that may meet the cone, as the device has them: in the session's frame, with reference
  /// distances of its camera.
  std::shared_ptr<const SharedMap> MapInView(const ViewCone& cone, const Pose3& T_map_session, uint32_t number);

 private:
  void DropFarthest(const Eigen::Vector3d& center_map);

  const TileGrid grid_;
  const size_t max_tiles_;
  const double focal_px_;  ///< of the device, whose distances the points are told for
  std::map<TileKey, Tile> tiles_;
};

}  // namespace mapp
