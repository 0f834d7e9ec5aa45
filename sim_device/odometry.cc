#include "sim_device/odometry.h"

#include <fmt/format.h>

#include <cmath>
#include <utility>

namespace mapp::sim {

Status OdometryNoise::Validate() const {
  const std::pair<const char*, double> fields[] = {
      {"position_m", position_m}, {"yaw_rad", yaw_rad}, {"yaw_per_turn_rad", yaw_per_turn_rad}};
  for (const auto& [name, value] : fields) {
    if (!(value >= 0) || !std::isfinite(value)) {
      return absl::InvalidArgumentError(fmt::format("{}: must be a number of at least 0, got {}", name, value));
    }
  }
  return absl::OkStatus();
}

Pose3 Odometry::Measure(const Pose3& T_before_after, const Eigen::Vector3d& up_before) {
  const double step_m = T_before_after.translation().norm();
  const double turn_rad = RotationAngle(Pose3(), T_before_after);
  const double position_sigma_m = noise_.position_m * std::sqrt(step_m);
  const double yaw_sigma =
      std::hypot(noise_.yaw_rad * std::sqrt(step_m), noise_.yaw_per_turn_rad * std::sqrt(turn_rad));
  constexpr double kTiltShare = 1.0 / 3.0;
  const Eigen::Vector3d position_error(rng_.Normal(), rng_.Normal(), rng_.Normal());
  Eigen::Vector3d rotation_error(rng_.Normal(), rng_.Normal(), rng_.Normal());
  rotation_error *= kTiltShare;
  rotation_error += up_before * (rng_.Normal() - up_before.dot(rotation_error));
  const Pose3 error(ExpSo3(yaw_sigma * rotation_error), position_sigma_m * position_error);
  return error * T_before_after;
}

}  // namespace mapp::sim
