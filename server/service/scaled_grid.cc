#include "server/service/scaled_grid.h"

#include <algorithm>

namespace mapp {
namespace {

/// Bounds the memory for views that are very wide or very deep; their cells are larger than the radius.
constexpr int kMaxCellsPerAxis = 64;

}  // namespace

ScaledGrid::ScaledGrid(const std::vector<Eigen::Vector3f>& points, float radius) : squared_radius_(radius * radius) {
  for (const Eigen::Vector3f& point : points) bounds_.extend(point);
  const Eigen::Array3f size = points.empty() ? Eigen::Array3f::Zero() : Eigen::Array3f(bounds_.sizes());
  const Eigen::Array3f cell = (size / kMaxCellsPerAxis).max(radius);
  inverse_cell_ = cell.inverse();
  num_cells_ = (size * inverse_cell_).cast<int>() + 1;

  // Counting sort by cell.
  cell_start_.assign(IndexOf(0, 0, num_cells_.z()) + 1, 0);
  std::vector<uint32_t> cells;
  cells.reserve(points.size());
  for (const Eigen::Vector3f& point : points) {
    const Eigen::Array3i at = CellOf(point);
    cells.push_back(static_cast<uint32_t>(IndexOf(at.x(), at.y(), at.z())));
    ++cell_start_[cells.back() + 1];
  }
  for (size_t i = 1; i < cell_start_.size(); ++i) cell_start_[i] += cell_start_[i - 1];
  std::vector<uint32_t> next(cell_start_.begin(), cell_start_.end() - 1);
  points_.resize(points.size());
  for (size_t i = 0; i < points.size(); ++i) points_[next[cells[i]]++] = points[i];
}

Eigen::Array3i ScaledGrid::CellOf(const Eigen::Vector3f& scaled) const {
  return ((scaled - bounds_.min()).array() * inverse_cell_).floor().cast<int>();
}

size_t ScaledGrid::IndexOf(int x, int y, int z) const {
  return (static_cast<size_t>(z) * static_cast<size_t>(num_cells_.y()) + static_cast<size_t>(y)) *
             static_cast<size_t>(num_cells_.x()) +
         static_cast<size_t>(x);
}

bool ScaledGrid::AnyWithin(const Eigen::Vector3f& scaled) const {
  if (points_.empty() || bounds_.squaredExteriorDistance(scaled) > squared_radius_) return false;
  const Eigen::Array3i at = CellOf(scaled);
  const Eigen::Array3i low = (at - 1).max(0);
  const Eigen::Array3i high = (at + 1).min(num_cells_ - 1);
  for (int z = low.z(); z <= high.z(); ++z) {
    for (int y = low.y(); y <= high.y(); ++y) {
      // Cells of one row lie together.
      const uint32_t begin = cell_start_[IndexOf(low.x(), y, z)];
      const uint32_t end = cell_start_[IndexOf(high.x(), y, z) + 1];
      for (uint32_t i = begin; i < end; ++i) {
        if ((points_[i] - scaled).squaredNorm() <= squared_radius_) return true;
      }
    }
  }
  return false;
}

}  // namespace mapp
