#include "mapp/geometry/neighbor_grid.h"

namespace mapp {

NeighborGrid::NeighborGrid(std::span<const Eigen::Vector3f> points, float edge) : edge_(edge), entries_(points.size()) {
  // Cells lie in the order of the points, so that those near to each other do where points are.
  std::vector<uint64_t> keys;
  for (const Eigen::Vector3f& p : points) {
    const auto [cell, is_new] = cells_.try_emplace(KeyOf(CellOf(p)));
    if (is_new) keys.push_back(cell->first);
    ++cell->second.end;
  }
  uint32_t begin = 0;
  for (const uint64_t key : keys) {
    Range& range = cells_.find(key)->second;
    const uint32_t num = range.end;
    range = {begin, begin};
    begin += num;
  }
  for (size_t i = 0; i < points.size(); ++i) {
    entries_[cells_.find(KeyOf(CellOf(points[i])))->second.end++] = {points[i], static_cast<uint32_t>(i)};
  }
}

size_t NeighborGrid::NumAround(const Eigen::Vector3f& p) const {
  const Cell center = CellOf(p);
  size_t num = 0;
  for (int64_t x = center.x - 1; x <= center.x + 1; ++x) {
    for (int64_t y = center.y - 1; y <= center.y + 1; ++y) {
      for (int64_t z = center.z - 1; z <= center.z + 1; ++z) {
        const auto cell = cells_.find(KeyOf({x, y, z}));
        if (cell != cells_.end()) num += cell->second.end - cell->second.begin;
      }
    }
  }
  return num;
}

}  // namespace mapp
