#pragma once

#include "mapp/base/id.h"
#include "mapp/base/status.h"
#include "mapp/geometry/pose3.h"
#include "mapp/map/tile.h"
#include "storage/records.h"

#include <Eigen/Core>

#include <array>
#include <cstdint>
#include <list>
#include <memory>
#include <span>
#include <unordered_map>
#include <vector>

namespace mapp {

class MapReader;

/// Cosine of the greatest angle between two rays to a point that see it alike, 50 degrees (OVERLAP study).
inline constexpr float kLikeViewCosine = 0.6427876F;

/// A map point as far as it takes to tell from where it can be seen.
struct SightedPoint {
  Eigen::Vector3f p_map;
  float reference_distance_m = 1;  ///< as TilePoint::reference_distance_m
  MapPointId id;
  SessionId founder;
  uint32_t num_directions = 0;
  /// Unit vectors from observing camera centres to the point.
  std::array<Eigen::Vector3f, TilePoint::kMaxObservers> directions;
};

/// A map's points by tile, read when asked for; the tiles used last are kept. Thread-compatible.
class PointTiles {
 public:
  using Points = std::shared_ptr<const std::vector<SightedPoint>>;

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
