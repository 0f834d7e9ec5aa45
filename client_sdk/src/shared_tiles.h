#pragma once

#include "mapp/client/map_client.h"
#include "mapp/client/shared_map.h"
#include "mapp/map/tile.h"
#include "tile_folder.h"

#include <cstdint>
#include <map>
#include <memory>
#include <optional>
#include <set>
#include <string>
#include <variant>
#include <vector>

namespace mapp {

/// The tiles a device has received, in memory and, with a folder, beyond the session, so that each is sent once per
/// revision. A tile is used only when the server has said, in the answer that is being taken in, that it is as the
/// device has it. One thread only.
class SharedTiles {
 public:
  /// Beyond `max_tiles` those farthest from the latest view are dropped from memory. `folder` may be null.
  SharedTiles(double tile_edge_m, size_t max_tiles, const Camera& camera, std::unique_ptr<TileFolder> folder = nullptr);

  /// What to tell the server: the tiles held within `reach_m` of a place, those in the folder included. One that is
  /// damaged there, or is no tile of this grid, is removed.
  std::vector<ClientHeldTile> Held(const Eigen::Vector3d& p_map, double reach_m);
  /// Drops what is older than the revision that changed it.
  void Forget(const std::map<TileKey, Revision>& changed);

  struct Taken {
    std::vector<TileKey> keys;  ///< of the tiles that are the shared map
    size_t num_cached = 0;      ///< of these, tiles that came from the folder and are used for the first time
  };
  /// Takes in the answer to a request that named `held`: newly received tiles, which replace older ones, and what is to
  /// be dropped. They are stored by StoreNew().
  Taken Take(ClientSharedMap received, const std::vector<ClientHeldTile>& held);
  /// Writes what has been taken in since the last call to the folder. The first error; the others are tried all the
  /// same.
  Status StoreNew();
  /// All points of the tiles, as the device has them: in the session's frame, with reference distances of its camera.
  std::shared_ptr<const SharedMap> MapOf(const std::vector<TileKey>& keys, const Pose3& T_map_session,
                                         uint32_t number) const;
  /// Likewise of tiles that have come of an answer which is not whole yet.
  std::shared_ptr<const SharedMap> MapOf(const std::vector<ClientTile>& tiles, const Pose3& T_map_session,
                                         uint32_t number) const;
  /// As the device has it; null unless it is in memory, decoded.
  const Tile* Find(const TileKey& key) const;
  /// Call it where the device is now and then.
  void DropFarthest(const Eigen::Vector3d& p_map);

 private:
  struct Entry {
    Revision revision;
    uint32_t crc32c = 0;
    std::variant<Tile, std::string> content;  ///< as bytes until they are needed
  };
  struct NewTile {
    TileKey key;
    std::string bytes;
  };

  bool IsInReach(const TileKey& key, const Eigen::Vector3d& p_map, double reach_m) const;
  std::optional<Entry> ReadFromFolder(const TileKey& key) const;
  void Drop(const TileKey& key);
  /// Makes a tile of its bytes, if it still is bytes. False: they are none.
  static bool Decode(Entry& entry);

  const TileGrid grid_;
  const size_t max_tiles_;
  const double focal_px_;  ///< of the device, whose distances the points are told for
  const std::unique_ptr<TileFolder> folder_;
  std::set<TileKey> in_folder_;  ///< and not in memory
  std::map<TileKey, Entry> tiles_;
  std::vector<NewTile> new_;
};

}  // namespace mapp
