#include "mapp/view/occupancy.h"

#include "mapp/base/check.h"

#include <algorithm>
#include <cmath>

namespace mapp {

OccupancyGrid::OccupancyGrid(const DepthSketch& sketch, OccupancyResolution resolution) : resolution_(resolution) {
  MAPP_CHECK(resolution.subdivision >= 1 && resolution.subdivision <= OccupancyResolution::kMax);
  MAPP_CHECK(resolution.depth_steps >= 1 && resolution.depth_steps <= OccupancyResolution::kMax);
  const auto columns_per_cell = static_cast<size_t>(resolution.subdivision * resolution.subdivision);
  size_t num_bins = 0;
  for (size_t cell = 0; cell < depths_.size(); ++cell) {
    first_bin_[cell] = num_bins;
    const DepthSketch::Cell& codes = sketch.cells[cell];
    if (codes.near_code == 0) continue;
    const int first = (codes.near_code - 1) / resolution.depth_steps - 1;
    const int last = (codes.far_code - 1) / resolution.depth_steps + 1;
    depths_[cell] = {first, last - first + 1};
    num_bins += columns_per_cell * static_cast<size_t>(depths_[cell].count);
  }
  occupied_.assign(num_bins, false);
}

OccupancyGrid::DepthRange OccupancyGrid::DepthsOf(int column, int row) const {
  const int cell = row / resolution_.subdivision * DepthSketch::kColumns + column / resolution_.subdivision;
  return depths_[static_cast<size_t>(cell)];
}

size_t OccupancyGrid::num_occupied() const {
  return static_cast<size_t>(std::count(occupied_.begin(), occupied_.end(), true));
}

std::optional<size_t> OccupancyGrid::IndexOf(int column, int row, int depth) const {
  if (column < 0 || column >= columns() || row < 0 || row >= rows()) return std::nullopt;
  const int s = resolution_.subdivision;
  const auto cell = static_cast<size_t>(row / s * DepthSketch::kColumns + column / s);
  const DepthRange& depths = depths_[cell];
  if (depth < depths.first || depth >= depths.first + depths.count) return std::nullopt;
  const int column_in_cell = row % s * s + column % s;
  return first_bin_[cell] + static_cast<size_t>(column_in_cell * depths.count + depth - depths.first);
}

bool OccupancyGrid::IsOccupied(int column, int row, int depth) const {
  const std::optional<size_t> index = IndexOf(column, row, depth);
  return index && occupied_[*index];
}

void OccupancyGrid::Occupy(int column, int row, int depth) {
  if (const std::optional<size_t> index = IndexOf(column, row, depth)) occupied_[*index] = true;
}

std::optional<Eigen::Vector3d> OccupancyGrid::Locate(const Camera& camera, const Eigen::Vector3d& p_camera) const {
  if (p_camera.z() <= 0) return std::nullopt;
  const Eigen::Vector2d pixel = camera.Project(p_camera);
  const Eigen::Vector2d share((pixel.x() + 0.5) / camera.width_px, (pixel.y() + 0.5) / camera.height_px);
  if (!(share.minCoeff() >= 0 && share.maxCoeff() < 1)) return std::nullopt;
  return Eigen::Vector3d(share.x() * columns(), share.y() * rows(),
                         (DepthSketch::CodeOfDepth(p_camera.z()) - 1) / resolution_.depth_steps);
}

bool OccupancyGrid::AnyWithin(const Eigen::Vector3d& location, double tolerance) const {
  const Eigen::Vector3i low = (location.array() - tolerance).floor().cast<int>();
  const Eigen::Vector3i high = (location.array() + tolerance).floor().cast<int>();
  for (int row = low.y(); row <= high.y(); ++row) {
    for (int column = low.x(); column <= high.x(); ++column) {
      for (int depth = low.z(); depth <= high.z(); ++depth) {
        if (IsOccupied(column, row, depth)) return true;
      }
    }
  }
  return false;
}

double OccupancyGrid::NearEnd(int depth) const {
  return DepthSketch::DepthOfCode(1 + static_cast<double>(depth) * resolution_.depth_steps);
}

}  // namespace mapp
