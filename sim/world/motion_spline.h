#pragma once

#include "datasets/sequence.h"
#include "mapp/base/status.h"
#include "mapp/geometry/pose3.h"

#include <Eigen/Core>

#include <cstdint>
#include <vector>

namespace mapp::sim {

/// How a body moves at one moment.
struct MotionState {
  Pose3 T_world_body;
  Eigen::Vector3d v_world;                ///< m/s
  Eigen::Vector3d a_world;                ///< m/s^2
  Eigen::Vector3d angular_velocity_body;  ///< rad/s
};

/// A twice continuously differentiable motion through stamped poses. Positions, and the coefficients of the rotations'
/// quaternions, are natural cubic splines; a quaternion is normalized after that, which costs nothing as long as
/// neighboring poses differ by less than about a radian. Immutable.
class MotionSpline {
 public:
  /// INVALID_ARGUMENT naming the time: fewer than 2 poses, a pose that is not finite, or times that do not increase.
  static StatusOr<MotionSpline> Through(const std::vector<StampedPose>& T_world_body);

  int64_t start_ns() const { return stamps_ns_.front(); }
  int64_t end_ns() const { return stamps_ns_.back(); }
  /// Times outside [start, end] count as the nearer end.
  MotionState At(int64_t stamp_ns) const;

 private:
  using Knot = Eigen::Matrix<double, 7, 1>;  ///< position; x, y, z, w of the quaternion

  std::vector<int64_t> stamps_ns_;
  std::vector<Knot> values_;
  std::vector<Knot> second_derivatives_;  ///< per s^2
};

}  // namespace mapp::sim
