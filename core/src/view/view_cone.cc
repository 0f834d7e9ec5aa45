#include "mapp/view/view_cone.h"

#include <algorithm>
#include <cmath>
#include <numbers>

namespace mapp {

bool ViewCone::Contains(const Eigen::Vector3d& p_map) const {
  const Eigen::Vector3d p_camera = T_map_camera.Inverse() * p_map;
  const double distance = p_camera.norm();
  if (distance > range_m) return false;
  if (distance == 0) return true;
  const double half_angle = std::min(0.5 * field_of_view, std::numbers::pi);
  return p_camera.z() >= distance * std::cos(half_angle);
}

Aabb ViewCone::BoundingBox() const {
  const Eigen::Vector3d apex = T_map_camera.translation();
  const Eigen::Vector3d axis = T_map_camera.rotation() * Eigen::Vector3d::UnitZ();
  const double half_angle = std::min(0.5 * field_of_view, std::numbers::pi);
  Aabb box(apex, apex);
  // The farthest point of the spherical cone along a direction d: range * d itself where d is inside the cone, else on
  // the rim, at the angle (between axis and d) - half_angle from d; never less than the apex.
  for (int i = 0; i < 3; ++i) {
    for (const double sign : {-1.0, 1.0}) {
      const double angle = std::acos(std::clamp(sign * axis[i], -1.0, 1.0));
      const double reach = range_m * std::cos(std::max(0.0, angle - half_angle));
      if (reach <= 0) continue;
      Eigen::Vector3d tip = apex;
      tip[i] += sign * reach;
      box.extend(tip);
    }
  }
  return box;
}

bool IsNeighbor(const ViewCone& query, const Pose3& T_map_frame, double frame_field_of_view) {
  const double max_distance = 2 * query.range_m;  // T_D
  if ((query.T_map_camera.translation() - T_map_frame.translation()).squaredNorm() >= max_distance * max_distance) {
    return false;
  }
  const Eigen::Vector3d query_axis = query.T_map_camera.rotation() * Eigen::Vector3d::UnitZ();
  const Eigen::Vector3d frame_axis = T_map_frame.rotation() * Eigen::Vector3d::UnitZ();
  const double angle = std::acos(std::clamp(query_axis.dot(frame_axis), -1.0, 1.0));
  return angle < 0.5 * (query.field_of_view + frame_field_of_view);
}

std::vector<TileKey> TilesInView(const ViewCone& cone, const TileGrid& grid) {
  const Aabb box = cone.BoundingBox();
  const TileKey low = grid.KeyOf(box.min());
  const TileKey high = grid.KeyOf(box.max());
  const Eigen::Vector3d apex = cone.T_map_camera.translation();
  const Eigen::Vector3d axis = cone.T_map_camera.rotation() * Eigen::Vector3d::UnitZ();
  const double half_angle = std::min(0.5 * cone.field_of_view, std::numbers::pi);
  const double radius = 0.5 * std::sqrt(3.0) * grid.edge_m;  // of the sphere around a cube
  std::vector<std::pair<double, TileKey>> found;
  for (int32_t x = low.x; x <= high.x; ++x) {
    for (int32_t y = low.y; y <= high.y; ++y) {
      for (int32_t z = low.z; z <= high.z; ++z) {
        const TileKey key{x, y, z};
        const Aabb cube = grid.BoxOf(key);
        const double nearest = cube.exteriorDistance(apex);
        if (nearest > cone.range_m) continue;
        const Eigen::Vector3d to_center = cube.center() - apex;
        const double distance = to_center.norm();
        if (distance > radius) {
          const double angle = std::acos(std::clamp(to_center.dot(axis) / distance, -1.0, 1.0));
          if (angle - std::asin(radius / distance) > half_angle) continue;
        }
        found.emplace_back(nearest, key);
      }
    }
  }
  std::sort(found.begin(), found.end());
  std::vector<TileKey> keys;
  keys.reserve(found.size());
  for (const auto& [distance, key] : found) keys.push_back(key);
  return keys;
}

}  // namespace mapp
