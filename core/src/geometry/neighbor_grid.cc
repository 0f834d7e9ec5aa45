#include "mapp/geometry/neighbor_grid.h"

namespace mapp {

NeighborGrid::NeighborGrid(std::span<const Eigen::Vector3f> points, float edge)
    : edge_(edge), entries_(points.size()) {
  for (const Eigen::Vector3f& p : points) ++cells_[KeyOf(CellOf(p))].end;
  uint32_t begin = 0;
  for (auto& [key, range] : cells_) {
    const uint32_t num = range.end;
    range = {begin, begin};
    begin += num;
  }
  for (size_t i = 0; i < points.size(); ++i) {
    entries_[cells_.find(KeyOf(CellOf(points[i])))->second.end++] = {points[i], static_cast<uint32_t>(i)};
  }
}

}  // namespace mapp
