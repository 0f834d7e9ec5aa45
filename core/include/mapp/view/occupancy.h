#pragma once

#include "mapp/camera/camera_model.h"
#include "mapp/view/depth_sketch.h"

#include <Eigen/Core>

#include <array>
#include <cstddef>
#include <optional>
#include <vector>

namespace mapp {

/// How finely the bins of a view divide it.
struct OccupancyResolution {
  static constexpr int kMax = 16;
  int subdivision = 6;  ///< each image cell of the sketch has subdivision x subdivision columns; range [1, kMax]
  int depth_steps = 2;  ///< code steps of the sketch (2.7 % of depth each) in a bin; range [1, kMax]
  friend bool operator==(const OccupancyResolution&, const OccupancyResolution&) = default;
};

/// Which bins of a view hold map points: columns through the image, each cut at equal steps of ln depth. A column has
/// bins where its cell of the sketch has depths, and one more at either end; cells without depths have none. Both sides
/// of the wire derive the same bins from sketch and resolution, in integers.
class OccupancyGrid {
 public:
  /// Bins from `first` on, counted from 0.1 m.
  struct DepthRange {
    int first = 0;
    int count = 0;
  };

  OccupancyGrid(const DepthSketch& sketch, OccupancyResolution resolution);

  const OccupancyResolution& resolution() const { return resolution_; }
  int columns() const { return DepthSketch::kColumns * resolution_.subdivision; }
  int rows() const { return DepthSketch::kRows * resolution_.subdivision; }
  DepthRange DepthsOf(int column, int row) const;
  size_t num_bins() const { return occupied_.size(); }
  size_t num_occupied() const;

  /// False where there is no such bin.
  bool IsOccupied(int column, int row, int depth) const;
  /// Does nothing where there is no such bin.
  void Occupy(int column, int row, int depth);

  /// Where a point in the camera's frame lies, in bins; nullopt behind the camera and outside the image.
  std::optional<Eigen::Vector3d> Locate(const Camera& camera, const Eigen::Vector3d& p_camera) const;
  /// Whether a bin within `tolerance` bins of the location along every axis is occupied; range [0, 1).
  bool AnyWithin(const Eigen::Vector3d& location, double tolerance) const;

  /// Depth where bin `depth` begins, metres.
  double NearEnd(int depth) const;

 private:
  std::optional<size_t> IndexOf(int column, int row, int depth) const;

  OccupancyResolution resolution_;
  std::array<DepthRange, DepthSketch::kCells> depths_{};
  std::array<size_t, DepthSketch::kCells> first_bin_{};  // of each cell
  std::vector<bool> occupied_;
};

}  // namespace mapp
