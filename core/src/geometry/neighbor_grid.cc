#include "mapp/geometry/neighbor_grid.h"

namespace mapp {

NeighborGrid::NeighborGrid(std::span<const Eigen::Vector3f> points, float radius)
    : radius_(radius), points_(points.begin(), points.end()) {
  for (size_t i = 0; i < points_.size(); ++i) cells_[KeyOf(CellOf(points_[i]))].push_back(static_cast<uint32_t>(i));
}

}  // namespace mapp
