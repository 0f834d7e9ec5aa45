#include "sim_device/odometry.h"

#include <gtest/gtest.h>

#include <cmath>

namespace mapp::sim {
namespace {

/// Walks straight on along x, z up, and returns the end pose as measured.
Pose3 Walk(const OdometryNoise& noise, uint64_t seed, int num_steps, double step_m) {
  Odometry odometry(noise, seed);
  Pose3 T_session_camera;
  for (int i = 0; i < num_steps; ++i) {
    T_session_camera = T_session_camera * odometry.Measure(Pose3(Eigen::Quaterniond::Identity(), {step_m, 0, 0}),
                                                           Eigen::Vector3d::UnitZ());
  }
  return T_session_camera;
}

TEST(OdometryTest, WithoutNoiseMotionIsExact) {
  const Pose3 end = Walk({.position_m = 0, .yaw_rad = 0, .yaw_per_turn_rad = 0}, 1, 100, 0.1);
  EXPECT_NEAR(Distance(end, Pose3(Eigen::Quaterniond::Identity(), {10, 0, 0})), 0, 1e-9);
}

TEST(OdometryTest, ErrorsWalkWithTheRootOfTheWayHoweverItIsDivided) {
  const OdometryNoise noise{.position_m = 0.01, .yaw_rad = 0.002, .yaw_per_turn_rad = 0};
  constexpr int kRuns = 400;
  constexpr double kWay_m = 9;
  for (const int num_steps : {9, 90}) {
    double squared_yaw = 0, squared_roll = 0, squared_along = 0;
    for (uint64_t seed = 0; seed < kRuns; ++seed) {
      const Pose3 end = Walk(noise, seed, num_steps, kWay_m / num_steps);
      const Eigen::Vector3d rotation = LogSo3(end.rotation());
      squared_yaw += rotation.z() * rotation.z();
      squared_roll += rotation.x() * rotation.x();
      squared_along += std::pow(end.translation().x() - kWay_m, 2);
    }
    EXPECT_NEAR(std::sqrt(squared_yaw / kRuns), 0.002 * 3, 0.0008);
    EXPECT_NEAR(std::sqrt(squared_roll / kRuns), 0.002, 0.0003);
    EXPECT_NEAR(std::sqrt(squared_along / kRuns), 0.01 * 3, 0.004);
  }
}

TEST(OdometryTest, SameSeedGivesTheSameErrors) {
  EXPECT_EQ(Distance(Walk({}, 5, 20, 0.1), Walk({}, 5, 20, 0.1)), 0);
  EXPECT_GT(Distance(Walk({}, 5, 20, 0.1), Walk({}, 6, 20, 0.1)), 0);
}

TEST(OdometryTest, NamesTheFieldOutOfRange) {
  EXPECT_EQ(OdometryNoise{.yaw_rad = -1}.Validate().code(), absl::StatusCode::kInvalidArgument);
  EXPECT_TRUE(OdometryNoise{}.Validate().ok());
}

}  // namespace
}  // namespace mapp::sim
