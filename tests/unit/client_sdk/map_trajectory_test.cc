#include "mapp/client/device.h"

#include <gtest/gtest.h>

namespace mapp {
namespace {

Pose3 Shift(double x_m, double y_m = 0) { return Pose3(Eigen::Quaterniond::Identity(), {x_m, y_m, 0}); }

/// Ten frames a decimetre apart along x, each 100 ns after the one before, in a session shifted by 5 m along y.
DeviceFragment Straight() {
  DeviceFragment fragment;
  fragment.session.T_map_session = Shift(0, 5);
  for (int i = 0; i < 10; ++i) fragment.trajectory.push_back({100 * i, Shift(0.1 * i), false, std::nullopt});
  return fragment;
}

void ExpectAt(const TrajectoryPose& pose, double x_m, double y_m) {
  EXPECT_NEAR(pose.T_session_camera.translation().x(), x_m, 1e-9);
  EXPECT_NEAR(pose.T_session_camera.translation().y(), y_m, 1e-9);
}

TEST(MapTrajectoryTest, AFragmentThatIsNotAlignedHasNone) {
  DeviceFragment fragment = Straight();
  fragment.session.T_map_session.reset();
  EXPECT_TRUE(TrajectoryInMap(fragment).empty());
  EXPECT_FALSE(TrajectoryInMap(std::vector<DeviceFragment>{fragment}).has_value());
}

TEST(MapTrajectoryTest, WithoutTheMapsPosesTheAlignmentRules) {
  const std::vector<TrajectoryPose> poses = TrajectoryInMap(Straight());
  ASSERT_EQ(poses.size(), 10U);
  ExpectAt(poses[7], 0.7, 5);
}

TEST(MapTrajectoryTest, GoesThroughTheMapsPosesAndBendsBetweenThem) {
  DeviceFragment fragment = Straight();
  // The map has the third frame where the device had it, and the seventh 0.4 m further along y.
  fragment.keyframe_poses = {{.number = 1, .stamp_ns = 600, .T_map_camera = Shift(0.6, 5.4)},
                             {.number = 0, .stamp_ns = 200, .T_map_camera = Shift(0.2, 5)}};
  const std::vector<TrajectoryPose> poses = TrajectoryInMap(fragment);
  ExpectAt(poses[0], 0, 5);
  ExpectAt(poses[2], 0.2, 5);
  ExpectAt(poses[3], 0.3, 5.1);
  ExpectAt(poses[5], 0.5, 5.3);
  ExpectAt(poses[6], 0.6, 5.4);
  ExpectAt(poses[9], 0.9, 5.4);
}

TEST(MapTrajectoryTest, ATurnOfTheMapBetweenKeyframesShiftsFramesByTheirOwnDistanceOnly) {
  DeviceFragment fragment = Straight();
  // Far from the session's origin, as a small turn is what drift mostly comes to.
  for (TrajectoryPose& pose : fragment.trajectory) pose.T_session_camera = Shift(1000) * pose.T_session_camera;
  const Pose3 turn(ExpSo3({0, 0, 0.01}), Eigen::Vector3d::Zero());
  fragment.keyframe_poses = {{.number = 0, .stamp_ns = 0, .T_map_camera = Shift(1000, 5)},
                             {.number = 1, .stamp_ns = 900, .T_map_camera = Shift(1000.9, 5) * turn}};
  for (const TrajectoryPose& pose : TrajectoryInMap(fragment)) {
    EXPECT_NEAR(pose.T_session_camera.translation().y(), 5, 0.01);
  }
}

TEST(MapTrajectoryTest, KeyframesOfOtherTimesAreIgnored) {
  DeviceFragment fragment = Straight();
  fragment.keyframe_poses = {{.number = 0, .stamp_ns = 250, .T_map_camera = Shift(9, 9)}};
  ExpectAt(TrajectoryInMap(fragment)[2], 0.2, 5);
}

TEST(MapTrajectoryTest, FramesOnASharedMapStayWhereTheyWereFound) {
  DeviceFragment fragment = Straight();
  fragment.trajectory[4].on_shared_map = true;
  fragment.trajectory[4].T_map_session = Shift(0, 5.2);  // the session's alignment was corrected since
  ExpectAt(TrajectoryInMap(fragment)[4], 0.4, 5.2);
  ExpectAt(TrajectoryInMap(fragment)[5], 0.5, 5);

  fragment.keyframe_poses = {{.number = 0, .stamp_ns = 0, .T_map_camera = Shift(0, 5)}};
  const std::vector<TrajectoryPose> poses = TrajectoryInMap(fragment);
  ExpectAt(poses[2], 0.2, 5.1);
  ExpectAt(poses[4], 0.4, 5.2);
  ExpectAt(poses[9], 0.9, 5.2);
}

TEST(MapTrajectoryTest, FragmentsFollowEachOther) {
  DeviceFragment second = Straight();
  second.session.T_map_session = Shift(0, 7);
  DeviceFragment lost = Straight();
  lost.session.T_map_session.reset();
  const auto poses = TrajectoryInMap(std::vector<DeviceFragment>{Straight(), lost, second});
  ASSERT_TRUE(poses.has_value());
  ASSERT_EQ(poses->size(), 20U);
  ExpectAt(poses->front(), 0, 5);
  ExpectAt(poses->back(), 0.9, 7);
}

}  // namespace
}  // namespace mapp
