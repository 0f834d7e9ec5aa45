#pragma once

#include "mapp/camera/camera_model.h"

#include <Eigen/Core>

#include <vector>

namespace mapp::sim {

/// Four rays side by side, each by its point on the plane z = 1 of the camera's frame.
struct RayRow {
  static constexpr int kSize = 4;
  Eigen::Array4f x;
  Eigen::Array4f y;
};

/// Rays of a camera, by the point (x, y) where each meets the plane z = 1 of the camera's frame. Immutable.
class RayTable {
 public:
  /// `camera` must be valid.
  explicit RayTable(const Camera& camera);

  const Camera& camera() const { return camera_; }
  int width() const { return camera_.width_px; }
  int height() const { return camera_.height_px; }

  /// Through the centre of pixel (x, y).
  Eigen::Vector2f Center(int x, int y) const { return centers_.At(x, y); }
  /// Through the centres of the four pixels from (x, y) on; pixels beyond the image repeat its last one.
  RayRow CenterRow(int x, int y) const { return centers_.RowAt(x, y); }
  /// Through the top left corner of pixel (x, y), x in [0, width], y in [0, height].
  Eigen::Vector2f Corner(int x, int y) const { return corners_.At(x, y); }
  /// Through four corners likewise.
  RayRow CornerRow(int x, int y) const { return corners_.RowAt(x, y); }

  /// The box around all rays.
  const Eigen::AlignedBox2f& bounds() const { return bounds_; }

  /// Where the camera shows a point of the plane z = 1, in pixels, (0, 0) being the top left pixel's outer corner.
  Eigen::Vector2d ToImage(const Eigen::Vector2d& normalized) const {
    return (camera_.Project(normalized.homogeneous()).array() + 0.5).matrix();
  }

 private:
  /// Rays of a grid of positions; the last of each line is repeated, so that a row may begin anywhere.
  struct Grid {
    Grid(const Camera& camera, int width, int height, double offset_px);
    size_t Index(int column, int line) const {
      return static_cast<size_t>(line) * stride + static_cast<size_t>(column);
    }
    Eigen::Vector2f At(int column, int line) const { return {x[Index(column, line)], y[Index(column, line)]}; }
    RayRow RowAt(int column, int line) const {
      const size_t index = Index(column, line);
      return {Eigen::Map<const Eigen::Array4f>(&x[index]), Eigen::Map<const Eigen::Array4f>(&y[index])};
    }

    size_t stride;
    std::vector<float> x;
    std::vector<float> y;
  };

  Camera camera_;
  Grid centers_;
  Grid corners_;
  Eigen::AlignedBox2f bounds_;
};

}  // namespace mapp::sim
