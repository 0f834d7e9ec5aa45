#pragma once

#include "mapp/base/status.h"
#include "mapp/map/tile.h"
#include "mapp/view/view_cone.h"
#include "server/service/tile_reader.h"
#include "storage/records.h"

#include <memory>
#include <span>
#include <vector>

namespace mapp {

class MapStore;
class MapReader;
class LoadedTile;  // server/service/loaded_tile.h: immutable points, frames and FLANN KD-trees of one tile

/// What one commit did to a tile.
struct TileChange {
  TileKey key;
  std::vector<PointRecord> upserted;  ///< new or changed points of this tile
  std::vector<MapPointId> removed;    ///< points that left it
  std::vector<ObserverFrame> frames;  ///< observers of `upserted` points that the tile may not know yet
};

/// Tiles of all maps in memory, least recently used dropped beyond the byte limit; loaded from the store on demand.
/// Readers hold immutable snapshots. Thread-safe.
class TileCache {
 public:
  TileCache(MapStore& store, size_t max_bytes);
  ~TileCache();

  /// The map's tiles that may meet `box_map` and have points, from memory or loaded.
  StatusOr<std::vector<std::shared_ptr<const LoadedTile>>> TilesInBox(MapId map, const Aabb& box_map);
  /// The tile as it stands, or nullptr when it has no points.
  StatusOr<std::shared_ptr<const LoadedTile>> GetTile(MapId map, const TileKey& key);

  /// Called after a commit, in commit order (MapStore::Write's on_commit): takes appended and changed points into the
  /// tiles in memory, without reading the store. At most one change a tile.
  void Apply(MapId map, Revision revision, std::span<const TileChange> changes);
  /// Drops tiles in memory; the next use loads them. For commits that moved much (merge, optimisation).
  void Invalidate(MapId map, std::span<const TileKey> keys);
  void OnMapDeleted(MapId map);
  /// What somebody else holds within the same limit: tiles get the rest, and a quarter of it in any case.
  void MakeRoomFor(size_t others_bytes);
  size_t bytes() const;

 private:
  struct Impl;
  std::unique_ptr<Impl> impl_;
};

}  // namespace mapp
