#pragma once

#include <Eigen/Core>
#include <absl/container/flat_hash_map.h>

#include <cmath>
#include <cstdint>
#include <cstdlib>
#include <span>
#include <vector>

namespace mapp {

/// Points by cubic cells. Immutable.
class NeighborGrid {
 public:
  /// `edge`: of a cell, in the points' unit, > 0. Copies the points.
  NeighborGrid(std::span<const Eigen::Vector3f> points, float edge);

  /// How many points VisitWithin looks at: those in the cells around `p`.
  size_t NumAround(const Eigen::Vector3f& p) const;

  /// Calls `visit(size_t index, float squared_distance)` for every point within one edge of `p`.
  template <typename Visit>
  void VisitWithin(const Eigen::Vector3f& p, const Visit& visit) const {
    const Cell center = CellOf(p);
    for (int64_t x = center.x - 1; x <= center.x + 1; ++x) {
      for (int64_t y = center.y - 1; y <= center.y + 1; ++y) {
        for (int64_t z = center.z - 1; z <= center.z + 1; ++z) VisitCell({x, y, z}, p, edge_, visit);
      }
    }
  }

  /// Likewise within `max_distance` of `p`, in shells of cells from `p` outwards, until `is_done(float distance)` says
  /// that what lies further away does not matter: it is asked when all within the distance have been visited.
  template <typename Visit, typename IsDone>
  void VisitOutwards(const Eigen::Vector3f& p, float max_distance, const Visit& visit, const IsDone& is_done) const {
    const Cell center = CellOf(p);
    for (int64_t shell = 0; static_cast<float>(shell - 1) * edge_ < max_distance; ++shell) {
      for (int64_t x = -shell; x <= shell; ++x) {
        for (int64_t y = -shell; y <= shell; ++y) {
          // On the shell's sides all of z, within them its two ends.
          const bool is_side = std::abs(x) == shell || std::abs(y) == shell;
          for (int64_t z = -shell; z <= shell; z += is_side || shell == 0 ? 1 : 2 * shell) {
            VisitCell({center.x + x, center.y + y, center.z + z}, p, max_distance, visit);
          }
        }
      }
      if (is_done(static_cast<float>(shell) * edge_)) return;
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
  template <typename Visit>
  void VisitCell(const Cell& at, const Eigen::Vector3f& p, float max_distance, const Visit& visit) const {
    const auto cell = cells_.find(KeyOf(at));
    if (cell == cells_.end()) return;
    for (uint32_t i = cell->second.begin; i < cell->second.end; ++i) {
      const float squared = (entries_[i].p - p).squaredNorm();
      if (squared <= max_distance * max_distance) visit(static_cast<size_t>(entries_[i].index), squared);
    }
  }
  Cell CellOf(const Eigen::Vector3f& p) const {
    return {static_cast<int64_t>(std::floor(p.x() / edge_)), static_cast<int64_t>(std::floor(p.y() / edge_)),
            static_cast<int64_t>(std::floor(p.z() / edge_))};
  }
  /// 21 bits an axis; cells that far apart share one, which only costs the comparison of distances.
  static uint64_t KeyOf(const Cell& cell) {
    constexpr uint64_t kMask = (uint64_t{1} << 21) - 1;
    return (static_cast<uint64_t>(cell.x) & kMask) << 42 | (static_cast<uint64_t>(cell.y) & kMask) << 21 |
           (static_cast<uint64_t>(cell.z) & kMask);
  }

  float edge_;
  std::vector<Entry> entries_;  ///< those of a cell lie together
  absl::flat_hash_map<uint64_t, Range> cells_;
};

}  // namespace mapp
