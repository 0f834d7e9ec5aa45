#include "sim/ray_table.h"

#include <algorithm>

namespace mapp::sim {

RayTable::Grid::Grid(const Camera& camera, int width, int height, double offset_px)
    : stride(static_cast<size_t>(width) + RayRow::kSize) {
  x.reserve(stride * static_cast<size_t>(height));
  y.reserve(stride * static_cast<size_t>(height));
  for (int line = 0; line < height; ++line) {
    for (int column = 0; column < width; ++column) {
      const Eigen::Vector3d ray = camera.Unproject({column + offset_px, line + offset_px});
      x.push_back(static_cast<float>(ray.x()));
      y.push_back(static_cast<float>(ray.y()));
    }
    x.resize(x.size() + RayRow::kSize, x.back());
    y.resize(y.size() + RayRow::kSize, y.back());
  }
}

RayTable::RayTable(const Camera& camera)
    : camera_(camera),
      centers_(camera, camera.width_px, camera.height_px, 0),
      corners_(camera, camera.width_px + 1, camera.height_px + 1, -0.5) {
  const auto [left, right] = std::ranges::minmax(corners_.x);
  const auto [top, bottom] = std::ranges::minmax(corners_.y);
  bounds_ = {Eigen::Vector2f(left, top), Eigen::Vector2f(right, bottom)};
}

}  // namespace mapp::sim
