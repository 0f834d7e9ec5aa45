#pragma once

#include "mapp/base/rng.h"
#include "mapp/base/status.h"
#include "mapp/geometry/pose3.h"

#include <cstdint>

namespace mapp::sim {

/// Random walks that motion adds to the odometry of a device that maps for itself. The defaults are estimates of the
/// built-in tracker's drift, not fitted to it.
struct OdometryNoise {
  /// Sigma of the position's walk after one metre, in each direction; after n metres sqrt(n) times that.
  double position_m = 0.003;
  /// Sigma of the heading's walk after one metre, radians; roll and pitch, which gravity and floors hold, have a third.
  double yaw_rad = 0.0006;
  /// ... and after turning by one radian.
  double yaw_per_turn_rad = 0.001;

  Status Validate() const;  ///< INVALID_ARGUMENT naming the first field that is negative or not finite.
};

/// The camera's motion as a drifting odometry measures it.
class Odometry {
 public:
  Odometry(const OdometryNoise& noise, uint64_t seed) : noise_(noise), rng_(seed) {}

  /// Measured T_before_after of a true motion. `up_before`: the world's up in the camera's frame before it, unit.
  Pose3 Measure(const Pose3& T_before_after, const Eigen::Vector3d& up_before);

 private:
  OdometryNoise noise_;
  Rng rng_;
};

}  // namespace mapp::sim
