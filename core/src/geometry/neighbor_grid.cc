#include "mapp/geometry/neighbor_grid.h"

namespace mapp {

NeighborGrid::NeighborGrid(std::span<const Eigen::Vector3f> points, float radius)
    : radius_(radius), entries_(points.size()) {
  std::vector<Range*> ranges;  // an unordered_map's elements stay where they are
  ranges.reserve(points.size());
  for (const Eigen::Vector3f& p : points) {
    ranges.push_back(&cells_[KeyOf(CellOf(p))]);
    ++ranges.back()->end;
  }
  uint32_t begin = 0;
  for (auto& [key, range] : cells_) {
    const uint32_t num = range.end;
    range = {begin, begin};
    begin += num;
  }
  for (size_t i = 0; i < points.size(); ++i) entries_[ranges[i]->end++] = {points[i], static_cast<uint32_t>(i)};
}

}  // namespace mapp
