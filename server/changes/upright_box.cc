#include "server/changes/upright_box.h"

#include <algorithm>
#include <cmath>
#include <limits>
#include <numbers>
#include <utility>
#include <vector>

namespace mapp {
namespace {

constexpr int kYawSteps = 90;  // of one degree: a rectangle is the same after 90

struct Extent {
  double min = 0, max = 0;
  double size() const { return max - min; }
  double center() const { return 0.5 * (min + max); }
};

Extent ExtentWithoutStrays(std::vector<double>& values, double stray_share) {
  const auto num_strays = static_cast<std::ptrdiff_t>(stray_share * static_cast<double>(values.size()));
  std::nth_element(values.begin(), values.begin() + num_strays, values.end());
  const double min = values[static_cast<size_t>(num_strays)];
  std::nth_element(values.begin(), values.end() - 1 - num_strays, values.end());
  const double max = *(values.end() - 1 - num_strays);
  // What lies evenly from end to end has lost twice the share.
  const double lost = 0.5 * (max - min) * (1 / (1 - 2 * stray_share) - 1);
  return {min - lost, max + lost};
}

/// How close points lie to the sides of a rectangle (Zhang et al. 2017, closeness criterion of L-shape fitting): of a
/// thing that was seen from one side they lie along one or two of them, and the smallest rectangle may be turned.
double Closeness(std::span<const Eigen::Vector3f> p_map, const Eigen::Vector3d& x, const Extent& along_x,
                 const Eigen::Vector3d& y, const Extent& along_y) {
  constexpr double kLeast_m = 0.05;
  const Eigen::Vector3f x_map = x.cast<float>(), y_map = y.cast<float>();
  double sum = 0;
  for (const Eigen::Vector3f& p : p_map) {
    const double u = x_map.dot(p), v = y_map.dot(p);
    const double distance_m = std::min(
        {std::abs(u - along_x.min), std::abs(u - along_x.max), std::abs(v - along_y.min), std::abs(v - along_y.max)});
    sum += 1 / std::max(distance_m, kLeast_m);
  }
  return sum;
}

}  // namespace

Eigen::Vector3d UpDirection(std::span<const FrameRecord> frames) {
  Eigen::Vector3d sum = Eigen::Vector3d::Zero();
  for (const FrameRecord& frame : frames) sum -= frame.T_frame_camera.rotation() * Eigen::Vector3d::UnitY();
  return sum.norm() > 1e-9 ? Eigen::Vector3d(sum.normalized()) : Eigen::Vector3d(-Eigen::Vector3d::UnitY());
}

OrientedBox UprightBox(std::span<const Eigen::Vector3f> p_map, const Eigen::Vector3d& up_map, double stray_share,
                       double min_side_m) {
  const Eigen::Vector3d aside = up_map.unitOrthogonal();
  const Eigen::Vector3d ahead = up_map.cross(aside);
  std::vector<double> values(p_map.size());
  const auto extent_along = [&](const Eigen::Vector3d& axis) {
    std::transform(p_map.begin(), p_map.end(), values.begin(),
                   [&](const Eigen::Vector3f& p) { return axis.dot(p.cast<double>()); });
    return ExtentWithoutStrays(values, stray_share);
  };
  const Extent height = extent_along(up_map);
  double closest = -1;
  Eigen::Matrix3d R_map_box = Eigen::Matrix3d::Identity();
  Extent length, width;
  for (int step = 0; step < kYawSteps; ++step) {
    const double yaw = step * 0.5 * std::numbers::pi / kYawSteps;
    const Eigen::Vector3d x = std::cos(yaw) * aside + std::sin(yaw) * ahead;
    const Eigen::Vector3d y = up_map.cross(x);
    const Extent along_x = extent_along(x), along_y = extent_along(y);
    const double closeness = Closeness(p_map, x, along_x, y, along_y);
    if (closeness <= closest) continue;
    closest = closeness;
    length = along_x;
    width = along_y;
    R_map_box << x, y, up_map;
  }
  const Eigen::Vector3d center = R_map_box * Eigen::Vector3d(length.center(), width.center(), height.center());
  const Eigen::Vector3d size_m(length.size(), width.size(), height.size());
  return {Pose3(Eigen::Quaterniond(R_map_box), center), size_m.cwiseMax(min_side_m)};
}

std::vector<OrientedBox> WithHiddenPart(const OrientedBox& box_map, const Eigen::Vector3d& view_map) {
  constexpr double kLeastOneSided = 0.3;
  // What is as wide and high as a vehicle is as long as one; other things are as deep as they are wide or high.
  constexpr double kLeastVehicleWidth_m = 1.4, kGreatestVehicleWidth_m = 3.0, kLeastVehicleHeight_m = 0.8;
  constexpr double kVehicleLength_m = 4.5;
  const Eigen::Vector3d view_box = box_map.T_frame_box.rotation().conjugate() * view_map;
  const int shorter = box_map.size_m.x() < box_map.size_m.y() ? 0 : 1;
  std::vector<OrientedBox> boxes;
  for (const int depth_axis : {shorter, 1 - shorter}) {
    const double width_m = box_map.size_m[1 - depth_axis];
    const bool is_vehicle = width_m >= kLeastVehicleWidth_m && width_m <= kGreatestVehicleWidth_m &&
                            box_map.size_m.z() >= kLeastVehicleHeight_m;
    const double depth_m = is_vehicle ? kVehicleLength_m : std::max(width_m, box_map.size_m.z());
    const double added_m = depth_m - box_map.size_m[depth_axis];
    if (added_m <= 0 || std::abs(view_box[depth_axis]) < kLeastOneSided) continue;
    Eigen::Vector3d shift_box = Eigen::Vector3d::Zero();
    shift_box[depth_axis] = std::copysign(0.5 * added_m, view_box[depth_axis]);
    OrientedBox& box = boxes.emplace_back(box_map);
    box.size_m[depth_axis] += added_m;
    box.T_frame_box = box.T_frame_box * Pose3(Eigen::Quaterniond::Identity(), shift_box);
  }
  if (boxes.empty()) boxes.push_back(box_map);
  return boxes;
}

}  // namespace mapp
