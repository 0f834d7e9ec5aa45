#pragma once

#include <Eigen/Core>

#include <cmath>
#include <cstdint>
#include <span>
#include <unordered_map>
#include <vector>

namespace mapp {

/// Points by cubic cells, for searches within one fixed radius. Immutable.
class NeighborGrid {
 public:
  /// Radius in the points' unit, > 0. Copies the points.
  NeighborGrid(std::span<const Eigen::Vector3f> points, float radius);

  /// Calls `visit(size_t index, float squared_distance)` for every point within the radius of `p`.
  template <typename Visit>
  void VisitWithin(const Eigen::Vector3f& p, const Visit& visit) const {
    const Cell center = CellOf(p);
    for (int64_t x = center.x - 1; x <= center.x + 1; ++x) {
      for (int64_t y = center.y - 1; y <= center.y + 1; ++y) {
        for (int64_t z = center.z - 1; z <= center.z + 1; ++z) {
          const auto cell = cells_.find(KeyOf({x, y, z}));
          if (cell == cells_.end()) continue;
          for (uint32_t i = cell->second.begin; i < cell->second.end; ++i) {
            const float squared = (entries_[i].p - p).squaredNorm();
            if (squared <= radius_ * radius_) visit(static_cast<size_t>(entries_[i].index), squared);
          }
        }
      }
    }
  }

 private:
  struct Cell {
    int64_t x, y, z;
  };
  struct Entry {
    Eigen::Vector3f p;
    uint32_t index;
  };
  struct Range {
    uint32_t begin = 0, end = 0;
  };
  Cell CellOf(const Eigen::Vector3f& p) const {
    return {static_cast<int64_t>(std::floor(p.x() / radius_)), static_cast<int64_t>(std::floor(p.y() / radius_)),
            static_cast<int64_t>(std::floor(p.z() / radius_))};
  }
  /// 21 bits an axis; cells that far apart share one, which only costs the comparison of distances.
  static uint64_t KeyOf(const Cell& cell) {
    constexpr uint64_t kMask = (uint64_t{1} << 21) - 1;
    return (static_cast<uint64_t>(cell.x) & kMask) << 42 | (static_cast<uint64_t>(cell.y) & kMask) << 21 |
           (static_cast<uint64_t>(cell.z) & kMask);
  }

  float radius_;
  std::vector<Entry> entries_;  ///< those of a cell lie together
  std::unordered_map<uint64_t, Range> cells_;
};

}  // namespace mapp
