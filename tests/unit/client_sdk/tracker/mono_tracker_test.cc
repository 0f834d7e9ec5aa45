// One camera and no depth: the rendered room again, up to scale.
#include "mapp/client/orb_tracker.h"
#include "sim/renderer.h"
#include "sim/room.h"
#include "sim/sensor_noise.h"
#include "tests/unit/client_sdk/tracker/room_frames.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <memory>
#include <string>
#include <vector>

namespace mapp {
namespace {

using tracker_test::SynchronousOptions;

/// Of the way covered. What stereo leaves on the same frames is a tenth of it.
constexpr double kMaxErrorShare = 0.02;

class MonoTrackerTest : public ::testing::Test {
 protected:
  MonoTrackerTest() {
    camera_ = sim::RoomCamera();
    const auto scene = sim::BuildRoom(1);
    EXPECT_TRUE(scene.ok()) << scene.status();
    renderer_ = sim::MakeRasterRenderer(*scene, 2);
    Restart();
  }

  void Restart() {
    auto tracker = OrbTracker::CreateMono(camera_, SynchronousOptions());
    EXPECT_TRUE(tracker.ok()) << tracker.status();
    tracker_ = *std::move(tracker);
    num_tracked_ = 0;
    T_world_camera_.clear();
  }

  GrayImage Draw(const Pose3& T_world_camera) {
    auto image = renderer_->Render(camera_, T_world_camera);
    EXPECT_TRUE(image.ok()) << image.status();
    sim::AddSensorNoise({}, ++num_drawn_, *image);
    return std::move(image->gray);
  }
  TrackingResult Track(const GrayImage& gray) {
    TrackerFrame frame;
    frame.stamp_ns = ++num_tracked_ * 50'000'000;
    frame.gray = gray.View();
    const auto result = tracker_->Track(frame);
    EXPECT_TRUE(result.ok()) << result.status();
    return *result;
  }
  void ExpectNoMap(const TrackingResult& result) {
    EXPECT_EQ(result.state, TrackingState::kNotStarted) << "frame " << num_tracked_;
    EXPECT_TRUE(tracker_->TakeKeyframes().empty());
    EXPECT_TRUE(tracker_->Trajectory().empty());
    EXPECT_FALSE(tracker_->MakeKeyframeOfLastFrame().has_value());
  }

  /// The next view along the room's trajectory.
  GrayImage DrawNext() {
    T_world_camera_.push_back(sim::RoomTrajectory(0)[T_world_camera_.size()].T_world_camera);
    return Draw(T_world_camera_.back());
  }
  std::vector<TrackingState> Follow(size_t num_frames) {
    std::vector<TrackingState> states;
    for (size_t i = 0; i < num_frames; ++i) states.push_back(Track(DrawNext()).state);
    return states;
  }
  /// Frames are stamped from 1 on. Largest distance from the truth after the best similarity, over the length of the
  /// way.
  double ErrorShare() const {
    const std::vector<TrajectoryPose> poses = tracker_->Trajectory();
    Eigen::Matrix3Xd estimated(3, poses.size()), truth(3, poses.size());
    double way_m = 0;
    for (Eigen::Index i = 0; i < estimated.cols(); ++i) {
      const auto frame = static_cast<size_t>(poses[static_cast<size_t>(i)].stamp_ns / 50'000'000) - 1;
      estimated.col(i) = poses[static_cast<size_t>(i)].T_session_camera.translation();
      truth.col(i) = T_world_camera_[frame].translation();
      if (i > 0) way_m += (truth.col(i) - truth.col(i - 1)).norm();
    }
    const Sim3 T_world_session = AlignPoints(estimated, truth, /*with_scale=*/true);
    double worst_m = 0;
    for (Eigen::Index i = 0; i < estimated.cols(); ++i) {
      worst_m = std::max(worst_m, (T_world_session * estimated.col(i) - truth.col(i)).norm());
    }
    return worst_m / way_m;
  }

  Camera camera_;
  std::unique_ptr<sim::Renderer> renderer_;
  std::unique_ptr<OrbTracker> tracker_;
  std::vector<Pose3> T_world_camera_;
  uint64_t num_drawn_ = 0;
  int64_t num_tracked_ = 0;
};

TEST_F(MonoTrackerTest, FollowsTheCameraUpToScale) {
  const std::vector<TrackingState> states = Follow(40);
  EXPECT_EQ(states.front(), TrackingState::kNotStarted);
  const auto started = std::find(states.begin(), states.end(), TrackingState::kTracking);
  EXPECT_LT(started - states.begin(), 25);
  EXPECT_EQ(std::count(started, states.end(), TrackingState::kTracking), states.end() - started);
  EXPECT_LT(ErrorShare(), kMaxErrorShare);
  // The frames that proved the map were tracked too.
  EXPECT_GT(tracker_->Trajectory().size(), static_cast<size_t>(states.end() - started));
  EXPECT_EQ(tracker_->sensor(), SensorKind::kMono);
}

TEST_F(MonoTrackerTest, HandsOutKeyframesInUnitsOfTheFirstViewsDepth) {
  Follow(40);
  const std::vector<Keyframe> keyframes = tracker_->TakeKeyframes();
  ASSERT_GE(keyframes.size(), 3U);
  for (size_t i = 0; i < keyframes.size(); ++i) {
    EXPECT_EQ(keyframes[i].number, i);
    EXPECT_TRUE(Validate(keyframes[i], tracker_->camera(), tracker_->feature_settings()).ok())
        << Validate(keyframes[i], tracker_->camera(), tracker_->feature_settings());
  }
  EXPECT_EQ(keyframes.front().T_frame_camera.Matrix(), Pose3().Matrix());
  std::vector<float> depths;
  for (const KeyframeFeature& feature : keyframes.front().features) {
    if (feature.point) depths.push_back(feature.point->depth_m);
  }
  ASSERT_GE(depths.size(), 60U);
  std::nth_element(depths.begin(), depths.begin() + static_cast<std::ptrdiff_t>(depths.size() / 2), depths.end());
  // The adjustments that followed move it a little.
  EXPECT_NEAR(depths[depths.size() / 2], 1, 0.2);
}

TEST_F(MonoTrackerTest, ARotationMakesNoMap) {
  const Pose3 T_world_camera = sim::RoomTrajectory(0).front().T_world_camera;
  for (int i = 0; i < 40; ++i) {
    const Pose3 T_camera_turned(ExpSo3({0.02 * std::sin(0.3 * i), 0.015 * i, 0}), {0, 0, 0});
    ExpectNoMap(Track(Draw(T_world_camera * T_camera_turned)));
  }
}

TEST_F(MonoTrackerTest, AFrozenImageMakesNoMap) {
  const GrayImage frozen = Draw(sim::RoomTrajectory(0).front().T_world_camera);
  for (int i = 0; i < 20; ++i) ExpectNoMap(Track(frozen));
}

TEST_F(MonoTrackerTest, ACameraAtRestMakesNoMap) {
  const Pose3 T_world_camera = sim::RoomTrajectory(0).front().T_world_camera;
  for (int i = 0; i < 20; ++i) ExpectNoMap(Track(Draw(T_world_camera)));
}

TEST_F(MonoTrackerTest, AMapThatIsLostOnProbationIsForgottenAndBegunAnew) {
  const std::vector<TrackingState> undisturbed = Follow(40);
  const auto started = static_cast<size_t>(std::find(undisturbed.begin(), undisturbed.end(), TrackingState::kTracking) -
                                           undisturbed.begin());
  ASSERT_GT(started, 3U);
  ASSERT_LT(started, 25U);

  Restart();
  const GrayImage black(camera_.width_px, camera_.height_px, 0);
  for (size_t i = 0; i < started; ++i) {
    if (i + 3 == started) {
      ExpectNoMap(Track(black));
      T_world_camera_.push_back(T_world_camera_.back());
    } else {
      ExpectNoMap(Track(DrawNext()));
    }
  }
  ExpectNoMap(Track(DrawNext()));
  const std::vector<TrackingState> later = Follow(30);
  EXPECT_EQ(later.back(), TrackingState::kTracking);
  // The session's frame is a later camera than the first map's was, and all its frames lie after the black one.
  EXPECT_GT(tracker_->Trajectory().front().stamp_ns, static_cast<int64_t>(started - 2) * 50'000'000);
  EXPECT_LT(ErrorShare(), kMaxErrorShare);
}

TEST_F(MonoTrackerTest, RefusesImagesOfAnotherSize) {
  const GrayImage small(320, 240, 100);
  TrackerFrame frame;
  frame.stamp_ns = 1;
  frame.gray = small.View();
  EXPECT_EQ(tracker_->Track(frame).status().code(), absl::StatusCode::kInvalidArgument);
}

}  // namespace
}  // namespace mapp
