#include "sim/world/imu.h"

#include "mapp/base/check.h"
#include "mapp/base/rng.h"

#include <cmath>

namespace mapp::sim {
namespace {

Eigen::Vector3d NormalVector(Rng& rng, double sigma) {
  const double x = rng.Normal();
  const double y = rng.Normal();
  return sigma * Eigen::Vector3d(x, y, rng.Normal());
}

}  // namespace

std::vector<ImuSample> ReadImu(const MotionSpline& motion, double rate_hz, const ImuNoise& noise, uint64_t seed) {
  MAPP_CHECK(rate_hz > 0);
  Rng rng(seed);
  const double white = std::sqrt(rate_hz);
  const double walk = 1 / std::sqrt(rate_hz);
  const Eigen::Vector3d up_world = kGravity_m_s2 * Eigen::Vector3d::UnitZ();
  Eigen::Vector3d gyro_bias = NormalVector(rng, noise.gyro_start_bias);
  Eigen::Vector3d accel_bias = NormalVector(rng, noise.accel_start_bias);
  std::vector<ImuSample> samples;
  for (int64_t i = 0;; ++i) {
    const int64_t stamp_ns = motion.start_ns() + std::llround(static_cast<double>(i) * 1e9 / rate_hz);
    const MotionState state = motion.At(stamp_ns);
    ImuSample sample;
    sample.stamp_ns = stamp_ns;
    sample.angular_velocity_body =
        state.angular_velocity_body + gyro_bias + NormalVector(rng, noise.gyro_density * white);
    sample.acceleration_body = state.T_world_body.rotation().conjugate() * (state.a_world + up_world) + accel_bias +
                               NormalVector(rng, noise.accel_density * white);
    samples.push_back(sample);
    if (stamp_ns >= motion.end_ns()) return samples;
    gyro_bias += NormalVector(rng, noise.gyro_walk * walk);
    accel_bias += NormalVector(rng, noise.accel_walk * walk);
  }
}

}  // namespace mapp::sim
