#include "mapp/client/orb_tracker.h"
#include "tests/unit/client_sdk/tracker/room_frames.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <memory>
#include <optional>

namespace mapp {
namespace {

using tracker_test::Borrow;
using tracker_test::FirstRoomFrames;
using tracker_test::MakeSharedMap;
using tracker_test::RoomFrames;
using tracker_test::SynchronousOptions;

constexpr uint64_t kFirstServerId = 100000;
/// As in the tracker's own test: above the noise, below any mistake in the transforms.
constexpr double kPoseToleranceM = 0.02;
constexpr size_t kFramesToConfirm = 2;

/// A device that has mapped the first frames, and the map that a server would make of them.
class SharedMapTest : public ::testing::Test {
 protected:
  void SetUp() override {
    const auto mapper = MakeTracker();
    for (size_t i = 0; i < FirstRoomFrames().frames.size(); ++i) Track(*mapper, i);
    keyframes_ = mapper->TakeKeyframes();
    tracker_ = MakeTracker();
  }

  static std::unique_ptr<OrbTracker> MakeTracker() {
    auto tracker = OrbTracker::CreateRgbd(FirstRoomFrames().camera, SynchronousOptions());
    EXPECT_TRUE(tracker.ok()) << tracker.status();
    return *std::move(tracker);
  }
  static TrackingResult Track(OrbTracker& tracker, size_t frame_idx) {
    const auto result = tracker.Track(Borrow(FirstRoomFrames().frames[frame_idx]));
    EXPECT_TRUE(result.ok()) << result.status();
    return *result;
  }
  TrackingResult Track(size_t frame_idx) { return Track(*tracker_, frame_idx); }
  /// The frames that a new map takes to be confirmed: they are tracked on the device's own map.
  void TrackUntilAdopted(size_t first) {
    for (size_t i = first; i < first + kFramesToConfirm; ++i) {
      const TrackingResult result = Track(i);
      EXPECT_EQ(result.state, TrackingState::kTracking);
      EXPECT_FALSE(result.on_shared_map) << "frame " << i;
      EXPECT_EQ(result.shared_map_number, 0U) << "nothing to tell of yet";
    }
  }
  std::shared_ptr<const SharedMap> MapMovedBy(const Pose3& T_session_map, uint32_t number) const {
    return std::make_shared<SharedMap>(
        MakeSharedMap(keyframes_, FirstRoomFrames().camera, T_session_map, number, kFirstServerId));
  }
  static Pose3 TruePose(size_t i) {
    const RoomFrames& room = FirstRoomFrames();
    return room.T_world_camera.front().Inverse() * room.T_world_camera[i];
  }

  std::vector<Keyframe> keyframes_;
  std::unique_ptr<OrbTracker> tracker_;
};

TEST_F(SharedMapTest, LocalizesWithoutMakingKeyframes) {
  for (size_t i = 0; i < 4; ++i) Track(i);
  tracker_->TakeSharedMap(MapMovedBy(Pose3(), 1));
  TrackUntilAdopted(4);
  tracker_->TakeKeyframes();
  int num_would_be = 0;
  for (size_t i = 6; i < FirstRoomFrames().frames.size(); ++i) {
    const TrackingResult result = Track(i);
    EXPECT_TRUE(result.on_shared_map) << "frame " << i;
    EXPECT_EQ(result.shared_map_number, 1U);
    EXPECT_GE(result.num_shared_matches, 75);
    EXPECT_FALSE(result.is_keyframe);
    EXPECT_LT(Distance(result.T_session_camera, TruePose(i)), kPoseToleranceM) << "frame " << i;
    num_would_be += result.would_be_keyframe ? 1 : 0;
  }
  EXPECT_TRUE(tracker_->TakeKeyframes().empty());
  EXPECT_GE(num_would_be, 1);
  EXPECT_TRUE(tracker_->Trajectory().back().on_shared_map);
  EXPECT_FALSE(tracker_->Trajectory().front().on_shared_map);
}

TEST_F(SharedMapTest, StepsOntoAMapThatIsOffByTheAlignmentsError) {
  for (size_t i = 0; i < 4; ++i) Track(i);
  const Pose3 T_session_map(Eigen::Quaterniond(Eigen::AngleAxisd(0.02, Eigen::Vector3d::UnitY())), {0.06, -0.03, 0.05});
  tracker_->TakeSharedMap(MapMovedBy(T_session_map, 1));
  TrackUntilAdopted(4);
  for (size_t i = 6; i < 12; ++i) {
    const TrackingResult result = Track(i);
    ASSERT_TRUE(result.on_shared_map) << "frame " << i;
    // Nothing of the device's own map pulls the pose back.
    EXPECT_LT(Distance(result.T_session_camera, T_session_map * TruePose(i)), kPoseToleranceM) << "frame " << i;
  }
}

TEST_F(SharedMapTest, OdometryGoesOnSmoothlyOntoASharedMapAndOffIt) {
  const Pose3 T_session_map(Eigen::Quaterniond(Eigen::AngleAxisd(0.02, Eigen::Vector3d::UnitY())), {0.06, -0.03, 0.05});
  // Frame to frame, well below the step of 8 cm.
  constexpr double kSmoothM = 0.015;
  std::optional<Pose3> T_odometry_last;
  bool has_stepped = false;
  for (size_t i = 0; i < 14; ++i) {
    if (i == 4) tracker_->TakeSharedMap(MapMovedBy(T_session_map, 1));
    if (i == 10) tracker_->LeaveSharedMap();
    const TrackingResult result = Track(i);
    ASSERT_EQ(result.state, TrackingState::kTracking);
    EXPECT_EQ(result.T_map_session.has_value(), result.on_shared_map);
    const Pose3 T_odometry_camera = result.T_odometry_session * result.T_session_camera;
    if (T_odometry_last) {
      const Pose3 T_last_camera = T_odometry_last->Inverse() * T_odometry_camera;
      EXPECT_LT(Distance(T_last_camera, TruePose(i - 1).Inverse() * TruePose(i)), kSmoothM) << "frame " << i;
    }
    T_odometry_last = T_odometry_camera;
    has_stepped |= Distance(result.T_odometry_session, Pose3()) > 0.05;
  }
  EXPECT_TRUE(has_stepped) << "the step is in T_odometry_session";
}

TEST_F(SharedMapTest, MapsOnAmongTheServersPointsAfterLeaving) {
  for (size_t i = 0; i < 4; ++i) Track(i);
  const Pose3 T_session_map(Eigen::Quaterniond::Identity(), {0.05, 0, 0});
  tracker_->TakeSharedMap(MapMovedBy(T_session_map, 1));
  for (size_t i = 4; i < 8; ++i) Track(i);
  tracker_->TakeKeyframes();
  tracker_->LeaveSharedMap();
  const TrackingResult first = Track(8);
  EXPECT_TRUE(first.is_keyframe);
  EXPECT_FALSE(first.on_shared_map);
  EXPECT_EQ(first.shared_map_number, 0U);
  for (size_t i = 9; i < 20; ++i) {
    const TrackingResult result = Track(i);
    ASSERT_EQ(result.state, TrackingState::kTracking);
    EXPECT_LT(Distance(result.T_session_camera, T_session_map * TruePose(i)), kPoseToleranceM) << "frame " << i;
  }
  const std::vector<Keyframe> keyframes = tracker_->TakeKeyframes();
  ASSERT_FALSE(keyframes.empty());
  const auto count = [&keyframes](PointReference::Kind kind) {
    const auto& features = keyframes.front().features;
    return std::count_if(features.begin(), features.end(), [kind](const KeyframeFeature& feature) {
      return feature.point && feature.point->kind == kind;
    });
  };
  EXPECT_GE(count(PointReference::Kind::kMapPoint), 75);
  EXPECT_GT(count(PointReference::Kind::kSessionPoint), 0);
  for (const KeyframeFeature& feature : keyframes.front().features) {
    if (feature.point && feature.point->kind == PointReference::Kind::kMapPoint) {
      EXPECT_GE(feature.point->id, kFirstServerId);
    }
  }
}

TEST_F(SharedMapTest, KeepsItsOwnMapWhenTheSharedOneDoesNotFit) {
  for (size_t i = 0; i < 4; ++i) Track(i);
  auto elsewhere = std::make_shared<SharedMap>(*MapMovedBy(Pose3(), 1));
  for (SharedPoint& point : elsewhere->points) {
    for (uint64_t& word : point.descriptor.words) word = ~word;
  }
  tracker_->TakeSharedMap(elsewhere);
  for (size_t i = 4; i < 8; ++i) {
    const TrackingResult result = Track(i);
    EXPECT_EQ(result.state, TrackingState::kTracking);
    EXPECT_FALSE(result.on_shared_map);
    EXPECT_EQ(result.shared_map_number, 1U);
    EXPECT_LT(result.num_shared_matches, 75);
    EXPECT_LT(Distance(result.T_session_camera, TruePose(i)), kPoseToleranceM) << "frame " << i;
  }
  tracker_->LeaveSharedMap();
  EXPECT_EQ(Track(8).shared_map_number, 0U);
}

TEST_F(SharedMapTest, APlaceThatLooksTheSameIsNotSteppedTo) {
  for (size_t i = 0; i < 4; ++i) Track(i);
  const Pose3 T_session_map(Eigen::Quaterniond::Identity(), {0, 0, 16});  // the garage's next aisle
  tracker_->TakeSharedMap(MapMovedBy(T_session_map, 1));
  for (size_t i = 4; i < 8; ++i) {
    const TrackingResult result = Track(i);
    EXPECT_EQ(result.state, TrackingState::kTracking);
    EXPECT_FALSE(result.on_shared_map) << "frame " << i;
    EXPECT_LT(Distance(result.T_session_camera, TruePose(i)), kPoseToleranceM) << "frame " << i;
  }
}

TEST_F(SharedMapTest, GoesFromOneSharedMapToTheNext) {
  for (size_t i = 0; i < 4; ++i) Track(i);
  tracker_->TakeSharedMap(MapMovedBy(Pose3(), 1));
  TrackUntilAdopted(4);
  for (size_t i = 6; i < 9; ++i) EXPECT_EQ(Track(i).shared_map_number, 1U);
  const Pose3 T_session_map(Eigen::Quaterniond::Identity(), {0, 0.04, 0});
  tracker_->TakeSharedMap(MapMovedBy(T_session_map, 2));
  TrackUntilAdopted(9);
  for (size_t i = 11; i < 14; ++i) {
    const TrackingResult result = Track(i);
    EXPECT_EQ(result.shared_map_number, 2U);
    EXPECT_TRUE(result.on_shared_map);
    EXPECT_LT(Distance(result.T_session_camera, T_session_map * TruePose(i)), kPoseToleranceM) << "frame " << i;
  }
}

TEST_F(SharedMapTest, RelocalizesOnTheSharedMapAfterBeingLost) {
  for (size_t i = 0; i < 4; ++i) Track(i);
  tracker_->TakeSharedMap(MapMovedBy(Pose3(), 1));
  TrackUntilAdopted(4);
  EXPECT_TRUE(Track(6).on_shared_map);
  const RoomFrames& room = FirstRoomFrames();
  const GrayImage black(room.camera.width_px, room.camera.height_px, 0);
  TrackerFrame dark = Borrow(room.frames[7]);
  dark.gray = black.View();
  EXPECT_EQ(tracker_->Track(dark)->state, TrackingState::kLost);
  const TrackingResult found = Track(9);
  EXPECT_TRUE(found.on_shared_map);
  EXPECT_LT(Distance(found.T_session_camera, TruePose(9)), kPoseToleranceM);
}

}  // namespace
}  // namespace mapp
