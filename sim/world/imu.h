#pragma once

#include "sim/world/motion_spline.h"

#include <Eigen/Core>

#include <cstdint>
#include <vector>

namespace mapp::sim {

inline constexpr double kGravity_m_s2 = 9.81;  ///< along -z of the world

/// One reading of an IMU, in the body frame.
struct ImuSample {
  int64_t stamp_ns = 0;
  Eigen::Vector3d angular_velocity_body;  ///< rad/s
  Eigen::Vector3d acceleration_body;      ///< m/s^2, gravity included (an IMU at rest reads +9.81 upwards)
};

/// Continuous-time noise densities. Defaults: the ADIS16448 as EuRoC's imu0/sensor.yaml gives it. All zero is exact.
struct ImuNoise {
  double gyro_density = 1.6968e-4;  ///< rad/s/sqrt(Hz)
  double gyro_walk = 1.9393e-5;     ///< rad/s^2/sqrt(Hz)
  double accel_density = 2.0e-3;    ///< m/s^2/sqrt(Hz)
  double accel_walk = 3.0e-3;       ///< m/s^3/sqrt(Hz)
  double gyro_start_bias = 2e-3;    ///< standard deviation when switched on, rad/s
  double accel_start_bias = 2e-2;   ///< the same, m/s^2
};

/// What an IMU that moves like this reads: samples at `rate_hz` from the motion's start to the first one at or after
/// its end. The same seed gives the same noise.
std::vector<ImuSample> ReadImu(const MotionSpline& motion, double rate_hz, const ImuNoise& noise, uint64_t seed);

}  // namespace mapp::sim
