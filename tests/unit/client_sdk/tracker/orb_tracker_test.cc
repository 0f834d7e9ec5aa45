#include "mapp/client/orb_tracker.h"

#include "tests/unit/client_sdk/tracker/room_frames.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <algorithm>
#include <set>
#include <string>

namespace mapp {
namespace {

using ::testing::StartsWith;
using tracker_test::Borrow;
using tracker_test::FirstRoomFrames;
using tracker_test::RoomFrames;
using tracker_test::SynchronousOptions;

/// The rendered room's depth noise is some millimetres; a lost scale or a wrong transform is off by more than this.
constexpr double kPoseToleranceM = 0.02;
constexpr double kAngleTolerance = 0.01;

std::unique_ptr<OrbTracker> MakeTracker(const OrbTrackerOptions& options = SynchronousOptions()) {
  auto tracker = OrbTracker::CreateRgbd(FirstRoomFrames().camera, options);
  EXPECT_TRUE(tracker.ok()) << tracker.status();
  return *std::move(tracker);
}

std::string MessageOf(const Status& status) { return std::string(status.message()); }

/// Pose of frame i in the frame of the first camera.
Pose3 TruePose(const std::vector<Pose3>& T_world_camera, size_t i) {
  return T_world_camera.front().Inverse() * T_world_camera[i];
}

void ExpectNear(const Pose3& actual, const Pose3& expected, const std::string& what) {
  EXPECT_LT(Distance(actual, expected), kPoseToleranceM) << what;
  EXPECT_LT(RotationAngle(actual, expected), kAngleTolerance) << what;
}

/// Tracks frames [begin, end); all must be tracked.
std::vector<TrackingResult> TrackAll(OrbTracker& tracker, size_t begin, size_t end) {
  std::vector<TrackingResult> results;
  for (size_t i = begin; i < end; ++i) {
    const auto result = tracker.Track(Borrow(FirstRoomFrames().frames[i]));
    EXPECT_TRUE(result.ok()) << result.status();
    EXPECT_EQ(result->state, TrackingState::kTracking) << "frame " << i;
    results.push_back(*result);
  }
  return results;
}

TEST(OrbTrackerTest, FollowsTheCameraThroughARoom) {
  const RoomFrames& room = FirstRoomFrames();
  const auto tracker = MakeTracker();
  const auto results = TrackAll(*tracker, 0, room.frames.size());
  for (size_t i = 0; i < results.size(); ++i) {
    ExpectNear(results[i].T_session_camera, TruePose(room.T_world_camera, i), "frame " + std::to_string(i));
  }
  const auto trajectory = tracker->Trajectory();
  ASSERT_EQ(trajectory.size(), room.frames.size());
  for (size_t i = 0; i < trajectory.size(); ++i) {
    EXPECT_EQ(trajectory[i].stamp_ns, room.frames[i].stamp_ns);
    EXPECT_FALSE(trajectory[i].on_shared_map);
    ExpectNear(trajectory[i].T_session_camera, TruePose(room.T_world_camera, i), "corrected " + std::to_string(i));
  }
}

TEST(OrbTrackerTest, HandsOutEachKeyframeOnceValidAndInOrder) {
  const auto tracker = MakeTracker();
  const auto results = TrackAll(*tracker, 0, FirstRoomFrames().frames.size());
  const auto num_keyframes =
      std::count_if(results.begin(), results.end(), [](const TrackingResult& result) { return result.is_keyframe; });
  const std::vector<Keyframe> keyframes = tracker->TakeKeyframes();
  EXPECT_TRUE(tracker->TakeKeyframes().empty());
  ASSERT_EQ(keyframes.size(), static_cast<size_t>(num_keyframes));
  ASSERT_GE(keyframes.size(), 2U);
  for (size_t i = 0; i < keyframes.size(); ++i) {
    EXPECT_EQ(keyframes[i].number, i);
    EXPECT_TRUE(Validate(keyframes[i], tracker->camera(), tracker->feature_settings()).ok())
        << Validate(keyframes[i], tracker->camera(), tracker->feature_settings());
    std::set<uint64_t> ids;
    for (const KeyframeFeature& feature : keyframes[i].features) {
      if (!feature.point) continue;
      EXPECT_EQ(feature.point->kind, PointReference::Kind::kSessionPoint);
      EXPECT_TRUE(ids.insert(feature.point->id).second) << "two features with point " << feature.point->id;
    }
    EXPECT_GT(ids.size(), 200U);
  }
}

TEST(OrbTrackerTest, GivesTheSameOutputForTheSameInput) {
  const auto run = [] {
    const auto tracker = MakeTracker();
    TrackAll(*tracker, 0, 12);
    return tracker->Trajectory();
  };
  const auto first = run(), second = run();
  ASSERT_EQ(first.size(), second.size());
  for (size_t i = 0; i < first.size(); ++i) {
    EXPECT_EQ(first[i].T_session_camera.Matrix(), second[i].T_session_camera.Matrix()) << "frame " << i;
  }
}

TEST(OrbTrackerTest, MapsInAThreadOfItsOwn) {
  OrbTrackerOptions options;
  const auto tracker = MakeTracker(options);
  const auto results = TrackAll(*tracker, 0, FirstRoomFrames().frames.size());
  tracker->WaitForLocalMapping();
  const auto num_keyframes =
      std::count_if(results.begin(), results.end(), [](const TrackingResult& result) { return result.is_keyframe; });
  EXPECT_EQ(tracker->TakeKeyframes().size(), static_cast<size_t>(num_keyframes));
  EXPECT_GT(tracker->local_mapping().latency.total_ms(), 0);
}

TEST(OrbTrackerTest, SaysLostOnABlackImageAndFindsItselfAgain) {
  const RoomFrames& room = FirstRoomFrames();
  const auto tracker = MakeTracker();
  TrackAll(*tracker, 0, 6);
  const GrayImage black(room.camera.width_px, room.camera.height_px, 0);
  TrackerFrame dark = Borrow(room.frames[6]);
  dark.gray = black.View();
  const auto lost = tracker->Track(dark);
  ASSERT_TRUE(lost.ok()) << lost.status();
  EXPECT_EQ(lost->state, TrackingState::kLost);
  EXPECT_FALSE(tracker->MakeKeyframeOfLastFrame());
  const auto found = tracker->Track(Borrow(room.frames[7]));
  ASSERT_TRUE(found.ok()) << found.status();
  ASSERT_EQ(found->state, TrackingState::kTracking);
  ExpectNear(found->T_session_camera, TruePose(room.T_world_camera, 7), "relocalized");
  EXPECT_EQ(tracker->Trajectory().size(), 7U);
}

TEST(OrbTrackerTest, DoesNotStartOnABlackImage) {
  const RoomFrames& room = FirstRoomFrames();
  const auto tracker = MakeTracker();
  const GrayImage black(room.camera.width_px, room.camera.height_px, 0);
  TrackerFrame dark = Borrow(room.frames[0]);
  dark.gray = black.View();
  const auto result = tracker->Track(dark);
  ASSERT_TRUE(result.ok()) << result.status();
  EXPECT_EQ(result->state, TrackingState::kNotStarted);
  EXPECT_TRUE(tracker->Trajectory().empty());
}

TEST(OrbTrackerTest, RefusesBadFramesAndStaysAsItWas) {
  const RoomFrames& room = FirstRoomFrames();
  const auto tracker = MakeTracker();
  TrackAll(*tracker, 0, 3);

  TrackerFrame no_gray = Borrow(room.frames[3]);
  no_gray.gray = {};
  TrackerFrame no_depth = Borrow(room.frames[3]);
  no_depth.depth_m = {};
  const GrayImage small(320, 240, 100);
  TrackerFrame wrong_size = Borrow(room.frames[3]);
  wrong_size.gray = small.View();
  TrackerFrame backwards = Borrow(room.frames[3]);
  backwards.stamp_ns = room.frames[2].stamp_ns;
  const std::pair<TrackerFrame, const char*> cases[] = {
      {no_gray, "gray:"}, {no_depth, "depth_m:"}, {wrong_size, "gray:"}, {backwards, "stamp_ns:"}};
  for (const auto& [frame, field] : cases) {
    const auto refused = tracker->Track(frame);
    EXPECT_EQ(refused.status().code(), absl::StatusCode::kInvalidArgument);
    EXPECT_THAT(MessageOf(refused.status()), StartsWith(field));
  }
  EXPECT_EQ(tracker->Trajectory().size(), 3U);
  TrackAll(*tracker, 3, 5);
}

TEST(OrbTrackerTest, RefusesBadOptionsAndCameras) {
  const Camera camera = FirstRoomFrames().camera;
  const auto message = [&camera](const OrbTrackerOptions& options) {
    const auto tracker = OrbTracker::CreateRgbd(camera, options);
    EXPECT_EQ(tracker.status().code(), absl::StatusCode::kInvalidArgument);
    return MessageOf(tracker.status());
  };
  EXPECT_THAT(message({.num_features = 10}), StartsWith("num_features:"));
  EXPECT_THAT(message({.max_depth_m = -1}), StartsWith("max_depth_m:"));
  EXPECT_THAT(message({.min_tracked_points = 0}), StartsWith("min_tracked_points:"));
  EXPECT_THAT(message({.min_reference_ratio = 1.5}), StartsWith("min_reference_ratio:"));
  EXPECT_THAT(message({.local_window = 1}), StartsWith("local_window:"));

  Camera broken = camera;
  broken.projection = PinholeCamera{0, 500, 320, 240};
  const auto tracker = OrbTracker::CreateRgbd(broken, {});
  EXPECT_EQ(tracker.status().code(), absl::StatusCode::kInvalidArgument);
  EXPECT_THAT(MessageOf(tracker.status()), StartsWith("camera"));
}

TEST(OrbTrackerTest, MakesAWholeKeyframeOfTheLastFrameWithFreshNames) {
  const auto tracker = MakeTracker();
  TrackAll(*tracker, 0, 4);
  const auto first = tracker->MakeKeyframeOfLastFrame();
  const auto second = tracker->MakeKeyframeOfLastFrame();
  ASSERT_TRUE(first && second);
  EXPECT_TRUE(Validate(*first, tracker->camera(), tracker->feature_settings()).ok());
  ASSERT_EQ(first->features.size(), second->features.size());
  size_t num_shared = 0, num_fresh = 0;
  for (size_t i = 0; i < first->features.size(); ++i) {
    if (!first->features[i].point) continue;
    ++(first->features[i].point->id == second->features[i].point->id ? num_shared : num_fresh);
  }
  EXPECT_GT(num_shared, 100U) << "points of the map keep their names";
  EXPECT_GT(num_fresh, 0U) << "points that are in no map are named anew";
}

TEST(OrbTrackerTest, TracksAStereoPairWithoutDepthImages) {
  const tracker_test::RoomStereo room = tracker_test::MakeRoomStereo(8);
  const auto tracker = OrbTracker::CreateStereo(room.camera, room.camera, room.T_left_right, SynchronousOptions());
  ASSERT_TRUE(tracker.ok()) << tracker.status();
  EXPECT_EQ((*tracker)->sensor(), SensorKind::kStereo);
  EXPECT_NEAR((*tracker)->camera().stereo_baseline_m, 0.12, 1e-6);
  for (size_t i = 0; i < room.frames.size(); ++i) {
    const auto result = (*tracker)->Track(Borrow(room.frames[i]));
    ASSERT_TRUE(result.ok()) << result.status();
    ASSERT_EQ(result->state, TrackingState::kTracking) << "frame " << i;
    ExpectNear(result->T_session_camera, TruePose(room.T_world_camera, i), "frame " + std::to_string(i));
  }
  TrackerFrame no_right = Borrow(FirstRoomFrames().frames.back());
  const auto refused = (*tracker)->Track(no_right);
  EXPECT_THAT(MessageOf(refused.status()), StartsWith("right_gray:"));
}

}  // namespace
}  // namespace mapp
