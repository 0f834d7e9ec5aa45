#include "client_sdk/src/tracker/depth_points.h"
#include "client_sdk/src/tracker/frame.h"
#include "client_sdk/src/tracker/tracking_camera.h"

#include <gtest/gtest.h>

#include <cmath>
#include <limits>

namespace mapp::tracker {
namespace {

Keypoint At(float u_px, float v_px) {
  Keypoint keypoint;
  keypoint.u_px = u_px;
  keypoint.v_px = v_px;
  return keypoint;
}

TEST(LookUpDepthTest, TakesTheReadingAtTheNearestPixel) {
  DepthImage depth(20, 20, 2.0F);
  depth.at(10, 8) = 2.05F;
  EXPECT_FLOAT_EQ(LookUpDepth(depth.View(), At(10.4F, 7.6F)), 2.05F);
  EXPECT_FLOAT_EQ(LookUpDepth(depth.View(), At(12.6F, 8.0F)), 2.0F);
}

TEST(LookUpDepthTest, DoubtsReadingsAtDepthSteps) {
  DepthImage depth(20, 20, 2.0F);
  for (int y = 0; y < 20; ++y) {
    for (int x = 10; x < 20; ++x) depth.at(x, y) = 3.0F;
  }
  EXPECT_EQ(LookUpDepth(depth.View(), At(9, 5)), 0);
  EXPECT_EQ(LookUpDepth(depth.View(), At(10, 5)), 0);
  EXPECT_FLOAT_EQ(LookUpDepth(depth.View(), At(8, 5)), 2.0F);
  EXPECT_FLOAT_EQ(LookUpDepth(depth.View(), At(11, 5)), 3.0F);
}

TEST(LookUpDepthTest, HasNoneWhereTheSensorHasNone) {
  DepthImage depth(20, 20, 2.0F);
  depth.at(5, 5) = 0;
  depth.at(9, 9) = std::numeric_limits<float>::quiet_NaN();
  EXPECT_EQ(LookUpDepth(depth.View(), At(5, 5)), 0);
  EXPECT_EQ(LookUpDepth(depth.View(), At(9, 9)), 0);
  // A hole beside it is no step.
  EXPECT_FLOAT_EQ(LookUpDepth(depth.View(), At(6, 5)), 2.0F);
}

TEST(LookUpDepthTest, HasNoneAtTheBorderOrBeyond) {
  const DepthImage depth(20, 20, 2.0F);
  for (const Keypoint& keypoint : {At(0, 10), At(19, 10), At(10, 0), At(10, 19), At(-5, 10), At(25, 10)}) {
    EXPECT_EQ(LookUpDepth(depth.View(), keypoint), 0);
  }
}

/// `num_near` features 2 m away, then `num_far` from 16 m on, the farthest first, one of 60 m and one without depth.
Frame FrameWithDepths(size_t num_near, size_t num_far) {
  Frame frame;
  frame.depths_m.assign(num_near, 2.0F);
  for (size_t i = 0; i < num_far; ++i) frame.depths_m.push_back(16.0F - 0.02F * static_cast<float>(i));
  frame.depths_m.push_back(60);
  frame.depths_m.push_back(0);
  frame.features.resize(frame.depths_m.size());
  return frame;
}

TEST(FeaturesForPointsTest, TakesTheNearestOfTheFarWhereFewAreNear) {
  TrackingCamera camera;
  camera.max_depth_m = 6;
  const std::vector<size_t> chosen = FeaturesForPoints(FrameWithDepths(30, 200), camera);
  ASSERT_EQ(chosen.size(), 100U);
  for (size_t i = 0; i < 30; ++i) EXPECT_EQ(chosen[i], i);
  for (size_t i = 30; i < 100; ++i) EXPECT_EQ(chosen[i], i + 130) << "the last of the far ones are the nearest";
}

TEST(FeaturesForPointsTest, LeavesTheFarWhereEnoughAreNear) {
  TrackingCamera camera;
  camera.max_depth_m = 6;
  EXPECT_EQ(FeaturesForPoints(FrameWithDepths(150, 200), camera).size(), 150U);
  EXPECT_EQ(FeaturesForPoints(FrameWithDepths(0, 40), camera).size(), 40U);
  EXPECT_TRUE(FeaturesForPoints(FrameWithDepths(0, 0), camera).empty());
}

TEST(TrackingCameraTest, DepthReachesSixMetresOrFortyBaselines) {
  Camera camera;
  camera.projection = PinholeCamera{500, 500, 320, 240};
  camera.width_px = 640;
  camera.height_px = 480;
  EXPECT_DOUBLE_EQ(MakeTrackingCamera(camera, SensorKind::kRgbd, 0).max_depth_m, 6);
  EXPECT_DOUBLE_EQ(MakeTrackingCamera(camera, SensorKind::kRgbd, 3.5).max_depth_m, 3.5);
  camera.stereo_baseline_m = 0.11;
  const TrackingCamera stereo = MakeTrackingCamera(camera, SensorKind::kStereo, 0);
  EXPECT_DOUBLE_EQ(stereo.max_depth_m, 4.4);
  EXPECT_DOUBLE_EQ(stereo.own_map.bf_px_m, 55);
}

TEST(TrackingCameraTest, ContainsWhatTheDistortedImageShows) {
  Camera camera;
  camera.projection = RadialTangentialCamera{458, 457, 367, 248, -0.28, 0.07, 0, 0};
  camera.width_px = 752;
  camera.height_px = 480;
  const TrackingCamera tracking = MakeTrackingCamera(camera, SensorKind::kStereo, 0);
  // Barrel distortion: the undistorted image is larger than the recorded one.
  EXPECT_LT(tracking.min_px.x(), 0);
  EXPECT_GT(tracking.max_px.x(), 752);
  EXPECT_TRUE(tracking.Contains(tracking.pinhole.Project(camera.Unproject({5, 5}))));
  EXPECT_FALSE(tracking.Contains({-400, 240}));
}

}  // namespace
}  // namespace mapp::tracker
