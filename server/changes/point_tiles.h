#pragma once

#include "mapp/base/id.h"
#include "mapp/base/mutex.h"
#include "mapp/base/status.h"
#include "mapp/geometry/pose3.h"
#include "mapp/map/tile.h"
#include "mapp/view/sighted_points.h"
#include "storage/records.h"

#include <Eigen/Core>

#include <cstdint>
#include <list>
#include <memory>
#include <span>
#include <unordered_map>
#include <vector>

namespace mapp {

class MapReader;

/// A map's points by tile, read when asked for; the tiles used last are kept. Thread-safe.
class PointTiles {
 public:
  using Points = SightedPoints;

  /// Borrows the reader and the mutex under which it is asked. `frames`: all that stand in the map.
  PointTiles(MapReader& reader, Mutex& mutex, const MapRecord& map, std::span<const FrameRecord> frames,
             size_t max_kept_points);

  /// Of the tiles whose cubes meet the box.
  StatusOr<std::vector<Points>> InBox(const Aabb& box_map);

 private:
  StatusOr<Points> Get(const TileKey& key);
  /// Of what the store holds of a tile.
  SightedTile Sighted(std::span<const PointRecord> records) const;

  struct Tile {
    TileKey key;
    Points points;
  };
  using Kept = std::list<Tile>;

  Mutex& mutex_;
  MapReader& reader_ ABSL_GUARDED_BY(mutex_);
  const MapId map_;
  const TileGrid grid_;
  const size_t max_kept_points_;
  std::unordered_map<FrameId, Eigen::Vector3f> centers_;
  Kept kept_ ABSL_GUARDED_BY(mutex_);  // used last first
  std::unordered_map<TileKey, Kept::iterator> index_ ABSL_GUARDED_BY(mutex_);
  size_t num_kept_points_ ABSL_GUARDED_BY(mutex_) = 0;
};

}  // namespace mapp
