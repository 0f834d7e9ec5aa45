#pragma once

#include "mapp/base/id.h"
#include "mapp/map/tile.h"

#include <Eigen/Core>

#include <array>
#include <cstdint>
#include <memory>
#include <span>
#include <vector>

namespace mapp {

/// A map point as far as it takes to tell from where it can be seen.
struct SightedPoint {
  Eigen::Vector3f p_map;
  float reference_distance_m = 1;  ///< as TilePoint::reference_distance_m
  MapPointId id;
  SessionId founder;  ///< 0 where nobody asks: tiles do not tell it
  uint32_t num_directions = 0;
  /// Unit vectors from observing camera centres to the point.
  std::array<Eigen::Vector3f, TilePoint::kMaxObservers> directions;
};

/// Points of one tile, in blocks that a view can pass over. Immutable.
class SightedTile {
 public:
  /// Points that lie near to each other, in a ball.
  struct Block {
    Eigen::Vector3f center_map;
    float radius_m = 0;
    uint32_t begin = 0, end = 0;  ///< of points()
  };

  explicit SightedTile(std::vector<SightedPoint> points);

  /// By block, and in it by id.
  std::span<const SightedPoint> points() const { return points_; }
  std::span<const Block> blocks() const { return blocks_; }

 private:
  std::vector<SightedPoint> points_;
  std::vector<Block> blocks_;
};

using SightedPoints = std::shared_ptr<const SightedTile>;

}  // namespace mapp
