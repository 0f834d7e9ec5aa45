#pragma once

#include <Eigen/Core>
#include <Eigen/Geometry>

#include <vector>

namespace mapp {

/// Points in a view's scaled coordinates (view/sampler.h), sorted into cells of at least the search radius: a search
/// looks at 27 cells. Immutable.
class ScaledGrid {
 public:
  /// Requires radius > 0 and finite points.
  ScaledGrid(const std::vector<Eigen::Vector3f>& points, float radius);

  /// Whether a point lies within the radius of `scaled`.
  bool AnyWithin(const Eigen::Vector3f& scaled) const;

 private:
  Eigen::Array3i CellOf(const Eigen::Vector3f& scaled) const;
  size_t IndexOf(int x, int y, int z) const;

  float squared_radius_;
  Eigen::AlignedBox3f bounds_;
  Eigen::Array3f inverse_cell_;
  Eigen::Array3i num_cells_;
  std::vector<uint32_t> cell_start_;     // by cell, x fastest; one more than cells
  std::vector<Eigen::Vector3f> points_;  // cell by cell
};

}  // namespace mapp
