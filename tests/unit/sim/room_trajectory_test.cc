#include "sim/room.h"

#include <gtest/gtest.h>

#include <cmath>
#include <numbers>

namespace mapp::sim {
namespace {

constexpr double kMaxStep_m = 0.04;
constexpr double kMaxTurn = 2.5 * std::numbers::pi / 180;

class RoomTrajectoryTest : public testing::TestWithParam<int> {};

TEST_P(RoomTrajectoryTest, IsSmoothEnoughToTrack) {
  const auto poses = RoomTrajectory(GetParam());
  ASSERT_EQ(poses.size(), 150);
  for (size_t i = 1; i < poses.size(); ++i) {
    EXPECT_LE(Distance(poses[i - 1].T_world_camera, poses[i].T_world_camera), kMaxStep_m) << "frame " << i;
    EXPECT_LE(RotationAngle(poses[i - 1].T_world_camera, poses[i].T_world_camera), kMaxTurn) << "frame " << i;
    EXPECT_NEAR(static_cast<double>(poses[i].stamp_ns - poses[i - 1].stamp_ns), 1e9 / 15, 1.0);
  }
}

TEST_P(RoomTrajectoryTest, StaysUprightAndAboveTheTable) {
  for (const StampedPose& pose : RoomTrajectory(GetParam())) {
    const Eigen::Vector3d down_world = pose.T_world_camera.rotation() * Eigen::Vector3d::UnitY();
    EXPECT_LT(down_world.z(), -0.9);
    EXPECT_GT(pose.T_world_camera.translation().z(), 1.25);
    EXPECT_LT(pose.T_world_camera.translation().z(), 1.7);
    EXPECT_LT(pose.T_world_camera.translation().head<2>().norm(), 1.0);
  }
}

INSTANTIATE_TEST_SUITE_P(Sessions, RoomTrajectoryTest, testing::Values(0, 1, 2, 3, 17));

TEST(RoomTrajectoryTest, SessionsDoNotOverlapInTimeAndStartApart) {
  const auto first = RoomTrajectory(0);
  const auto second = RoomTrajectory(1);
  EXPECT_LT(first.back().stamp_ns, second.front().stamp_ns);
  EXPECT_GT(RotationAngle(first.front().T_world_camera, second.front().T_world_camera), 1.0);
}

}  // namespace
}  // namespace mapp::sim
