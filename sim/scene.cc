#include "sim/scene.h"

#include <Eigen/Geometry>

#include <algorithm>
#include <cmath>
#include <utility>

namespace mapp::sim {
namespace {

void BakeLight(const Lamp& lamp, const Eigen::Vector3d& corner_world, const Eigen::Vector3d& edge_u_world,
               const Eigen::Vector3d& edge_v_world, GrayImage& image) {
  const Eigen::Vector3d normal_world = edge_v_world.cross(edge_u_world).normalized();
  for (int y = 0; y < image.height; ++y) {
    const Eigen::Vector3d row_world = corner_world + edge_v_world * ((y + 0.5) / image.height);
    for (int x = 0; x < image.width; ++x) {
      const Eigen::Vector3d p_world = row_world + edge_u_world * ((x + 0.5) / image.width);
      const double level = image.at(x, y) * (lamp.ambient + UnshadowedLight(lamp.strength, lamp.reach_m,
                                                                            lamp.p_world - p_world, normal_world));
      image.at(x, y) = static_cast<uint8_t>(std::lround(std::clamp(level, 0.0, 255.0)));
    }
  }
}

}  // namespace

double UnshadowedLight(double strength, double reach_m, const Eigen::Vector3d& to_light_world,
                       const Eigen::Vector3d& normal_world) {
  const double distance_m = std::max(to_light_world.norm(), 1.0);
  const double lambert = std::max(normal_world.dot(to_light_world) / distance_m, 0.0);
  const double falloff = 1.0 / (1.0 + (distance_m / reach_m) * (distance_m / reach_m));
  return strength * lambert * falloff;
}

void AddQuad(const Eigen::Vector3d& corner_world, const Eigen::Vector3d& edge_u_world,
             const Eigen::Vector3d& edge_v_world, const Painter& paint, const Lamp& lamp, Scene& scene) {
  GrayImage image = paint(edge_u_world.norm(), edge_v_world.norm());
  BakeLight(lamp, corner_world, edge_u_world, edge_v_world, image);
  scene.quads.push_back(
      Quad{corner_world, edge_u_world, edge_v_world, std::make_shared<const Texture>(std::move(image))});
}

void AddBox(const BoxShape& box, const Painter& paint, const Lamp& lamp, Scene& scene) {
  const Eigen::Matrix3d R_world_box = Eigen::AngleAxisd(box.yaw, Eigen::Vector3d::UnitZ()).toRotationMatrix();
  const Eigen::Vector3d half_m = 0.5 * box.size_m;
  const auto add = [&](const Eigen::Vector3d& corner_box, const Eigen::Vector3d& edge_u_box,
                       const Eigen::Vector3d& edge_v_box) {
    AddQuad(box.center_world + R_world_box * corner_box, R_world_box * edge_u_box, R_world_box * edge_v_box, paint,
            lamp, scene);
  };
  const Eigen::Vector3d along_x(box.size_m.x(), 0, 0);
  const Eigen::Vector3d along_y(0, box.size_m.y(), 0);
  const Eigen::Vector3d down(0, 0, -box.size_m.z());
  add({-half_m.x(), -half_m.y(), half_m.z()}, along_x, down);
  add({half_m.x(), -half_m.y(), half_m.z()}, along_y, down);
  add({half_m.x(), half_m.y(), half_m.z()}, -along_x, down);
  add({-half_m.x(), half_m.y(), half_m.z()}, -along_y, down);
  add({-half_m.x(), half_m.y(), half_m.z()}, along_x, -along_y);
  const bool clear_of_floor = box.center_world.z() - half_m.z() > 0.01;
  if (clear_of_floor) add({-half_m.x(), -half_m.y(), -half_m.z()}, along_x, along_y);
}

}  // namespace mapp::sim
