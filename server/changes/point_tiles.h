#pragma once

#include "mapp/base/id.h"
#include "mapp/base/status.h"
#include "mapp/geometry/pose3.h"
#include "mapp/map/tile.h"
#include "mapp/view/point_judge.h"
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

/// A map's points by tile, read when asked for; the tiles used last are kept. Thread-compatible.
class PointTiles {
 public:
  using Points = SightedPoints;

  /// Borrows the reader. `frames`: all that stand in the map.
  PointTiles(MapReader& reader, const MapRecord& map, std::span<const FrameRecord> frames, size_t max_kept_points);

  /// Of the tiles whose cubes meet the box.
  StatusOr<std::vector<Points>> InBox(const Aabb& box_map);

 private:
  StatusOr<Points> Load(const TileKey& key);
  void DropOldest();

  struct Tile {
    TileKey key;
    Points points;
  };
  using Kept = std::list<Tile>;

  MapReader& reader_;
  const MapId map_;
  const TileGrid grid_;
  const size_t max_kept_points_;
  std::unordered_map<FrameId, Eigen::Vector3f> centers_;
  Kept kept_;  // used last first
  std::unordered_map<TileKey, Kept::iterator> index_;
  size_t num_kept_points_ = 0;
};

}  // namespace mapp
