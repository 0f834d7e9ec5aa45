#include "sim/ray_table.h"

namespace mapp::sim {
namespace {

/// Rays of the pixel positions (x + offset, y + offset), row by row.
std::vector<Eigen::Vector2f> Unproject(const Camera& camera, int width, int height, double offset_px) {
  std::vector<Eigen::Vector2f> rays;
  rays.reserve(static_cast<size_t>(width) * static_cast<size_t>(height));
  for (int y = 0; y < height; ++y) {
    for (int x = 0; x < width; ++x) {
      rays.emplace_back(camera.Unproject({x + offset_px, y + offset_px}).head<2>().cast<float>());
    }
  }
  return rays;
}

}  // namespace

RayTable::RayTable(const Camera& camera)
    : camera_(camera),
      centers_(Unproject(camera, camera.width_px, camera.height_px, 0)),
      corners_(Unproject(camera, camera.width_px + 1, camera.height_px + 1, -0.5)) {
  for (const Eigen::Vector2f& ray : corners_) bounds_.extend(ray);
}

}  // namespace mapp::sim
