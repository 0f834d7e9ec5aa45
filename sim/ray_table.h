#pragma once

#include "mapp/camera/camera_model.h"

#include <Eigen/Core>

#include <vector>

namespace mapp::sim {

/// Rays of a camera, by the point (x, y) where each meets the plane z = 1 of the camera's frame. Immutable.
class RayTable {
 public:
  /// `camera` must be valid.
  explicit RayTable(const Camera& camera);

  const Camera& camera() const { return camera_; }
  int width() const { return camera_.width_px; }
  int height() const { return camera_.height_px; }

  /// Through the centre of pixel (x, y).
  const Eigen::Vector2f& Center(int x, int y) const { return centers_[Index(x, y, width())]; }
  /// Through the top left corner of pixel (x, y), x in [0, width], y in [0, height].
  const Eigen::Vector2f& Corner(int x, int y) const { return corners_[Index(x, y, width() + 1)]; }

  /// The box around all rays.
  const Eigen::AlignedBox2f& bounds() const { return bounds_; }

  /// Where the camera shows a point of the plane z = 1, in pixels, (0, 0) being the top left pixel's outer corner.
  Eigen::Vector2d ToImage(const Eigen::Vector2d& normalized) const {
    return (camera_.Project(normalized.homogeneous()).array() + 0.5).matrix();
  }

 private:
  static size_t Index(int x, int y, int stride) {
    return static_cast<size_t>(y) * static_cast<size_t>(stride) + static_cast<size_t>(x);
  }

  Camera camera_;
  std::vector<Eigen::Vector2f> centers_;
  std::vector<Eigen::Vector2f> corners_;
  Eigen::AlignedBox2f bounds_;
};

}  // namespace mapp::sim
