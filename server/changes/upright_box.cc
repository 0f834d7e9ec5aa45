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
  double least_area_m2 = std::numeric_limits<double>::infinity();
  Eigen::Matrix3d R_map_box = Eigen::Matrix3d::Identity();
  Extent length, width;
  for (int step = 0; step < kYawSteps; ++step) {
    const double yaw = step * 0.5 * std::numbers::pi / kYawSteps;
    const Eigen::Vector3d x = std::cos(yaw) * aside + std::sin(yaw) * ahead;
    const Eigen::Vector3d y = up_map.cross(x);
    const Extent along_x = extent_along(x), along_y = extent_along(y);
    const double area_m2 = std::max(along_x.size(), min_side_m) * std::max(along_y.size(), min_side_m);
    if (area_m2 >= least_area_m2) continue;
    least_area_m2 = area_m2;
    length = along_x;
    width = along_y;
    R_map_box << x, y, up_map;
  }
  const Eigen::Vector3d center = R_map_box * Eigen::Vector3d(length.center(), width.center(), height.center());
  const Eigen::Vector3d size_m(length.size(), width.size(), height.size());
  return {Pose3(Eigen::Quaterniond(R_map_box), center), size_m.cwiseMax(min_side_m)};
}

OrientedBox WithHiddenPart(const OrientedBox& box_map, const Eigen::Vector3d& view_map) {
  constexpr double kLeastOneSided = 0.3, kWholePerHeight = 1.2, kDepthPerSide = 1.6, kLongestPerHeight = 1.3;
  const Eigen::Vector3d view_box = box_map.T_frame_box.rotation().conjugate() * view_map;
  const int depth_axis = box_map.size_m.x() < box_map.size_m.y() ? 0 : 1;
  const double width_m = box_map.size_m[1 - depth_axis], height_m = box_map.size_m.z();
  if (std::abs(view_box[depth_axis]) < kLeastOneSided) return box_map;
  if (box_map.size_m[depth_axis] > kWholePerHeight * height_m) return box_map;
  const double depth_m = kDepthPerSide * std::min(width_m, kLongestPerHeight * height_m);
  const double added_m = depth_m - box_map.size_m[depth_axis];
  if (added_m <= 0) return box_map;
  Eigen::Vector3d shift_box = Eigen::Vector3d::Zero();
  shift_box[depth_axis] = std::copysign(0.5 * added_m, view_box[depth_axis]);
  OrientedBox box = box_map;
  box.size_m[depth_axis] += added_m;
  box.T_frame_box = box.T_frame_box * Pose3(Eigen::Quaterniond::Identity(), shift_box);
  return box;
}

}  // namespace mapp
