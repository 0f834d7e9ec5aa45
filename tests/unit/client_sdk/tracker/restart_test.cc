// A device that is carried to another place: the tracker begins again there, and no pose of the one place is told in
// the frame of the other.
#include "mapp/base/check.h"
#include "mapp/client/orb_tracker.h"
#include "sim/room.h"
#include "tests/unit/client_sdk/tracker/room_frames.h"

#include <gtest/gtest.h>

#include <memory>
#include <vector>

namespace mapp {
namespace {

using tracker_test::Borrow;
using tracker_test::FirstRoomFrames;
using tracker_test::MakeSharedMap;
using tracker_test::SynchronousOptions;

constexpr double kPoseToleranceM = 0.02;
constexpr size_t kNumHere = 8;
constexpr size_t kNumElsewhere = 14;
/// Six frames at 15 Hz.
constexpr double kSearchS = 0.39;
constexpr size_t kNumLost = 6;

/// The first frames of another room's walk.
const std::vector<SequenceFrame>& OtherRoomFrames() {
  static const std::vector<SequenceFrame> frames = [] {
    sim::RoomOptions options;
    options.seed = 2;
    const auto sequence = sim::MakeRoomSequence(options);
    MAPP_CHECK(sequence.ok());
    std::vector<SequenceFrame> drawn;
    for (size_t i = 0; i < kNumElsewhere; ++i) {
      auto frame = (*sequence)->Read(i);
      MAPP_CHECK(frame.ok());
      drawn.push_back(*std::move(frame));
    }
    return drawn;
  }();
  return frames;
}

class RestartTest : public ::testing::Test {
 protected:
  RestartTest() {
    options_ = SynchronousOptions();
    options_.max_young_search_s = kSearchS;
  }
  void SetUp() override { Begin(); }
  void Begin() {
    auto tracker = OrbTracker::CreateRgbd(FirstRoomFrames().camera, options_);
    ASSERT_TRUE(tracker.ok()) << tracker.status();
    tracker_ = *std::move(tracker);
  }

  /// Frames come at 15 Hz, wherever they are from.
  TrackingResult Track(const SequenceFrame& drawn) {
    SequenceFrame frame = drawn;
    frame.stamp_ns = stamp_ns_;
    stamp_ns_ += 1'000'000'000 / 15;
    const auto result = tracker_->Track(Borrow(frame));
    EXPECT_TRUE(result.ok()) << result.status();
    return *result;
  }
  void TrackHere() {
    for (size_t i = 0; i < kNumHere; ++i) {
      const TrackingResult result = Track(FirstRoomFrames().frames[i]);
      ASSERT_EQ(result.state, TrackingState::kTracking);
      ASSERT_EQ(result.fragment, 0U);
    }
  }
  /// Both rooms are walked through alike.
  static Pose3 TruePose(size_t from, size_t i) {
    const auto& T_world_camera = FirstRoomFrames().T_world_camera;
    return T_world_camera[from].Inverse() * T_world_camera[i];
  }
  /// The frames elsewhere until the restart, which must be that of fragment `next`.
  void TrackElsewhereUntilRestart(uint32_t next) {
    for (size_t i = 0; i + 1 < kNumLost; ++i) {
      const TrackingResult lost = Track(OtherRoomFrames()[i]);
      ASSERT_EQ(lost.state, TrackingState::kLost) << "frame " << i;
      ASSERT_EQ(lost.fragment, next - 1);
    }
    const TrackingResult restarted = Track(OtherRoomFrames()[kNumLost - 1]);
    ASSERT_EQ(restarted.state, TrackingState::kTracking);
    EXPECT_EQ(restarted.fragment, next);
    EXPECT_TRUE(restarted.is_keyframe);
    EXPECT_LT(Distance(restarted.T_session_camera, Pose3()), 1e-9);
  }

  OrbTrackerOptions options_;
  std::unique_ptr<OrbTracker> tracker_;
  int64_t stamp_ns_ = 1;
};

TEST_F(RestartTest, GoesOnInAFrameOfItsOwnWhereItsMapIsOfNoUse) {
  TrackHere();
  TrackElsewhereUntilRestart(1);
  for (size_t i = kNumLost; i < kNumElsewhere; ++i) {
    const TrackingResult result = Track(OtherRoomFrames()[i]);
    ASSERT_EQ(result.state, TrackingState::kTracking) << "frame " << i;
    EXPECT_EQ(result.fragment, 1U);
    EXPECT_LT(Distance(result.T_session_camera, TruePose(kNumLost - 1, i)), kPoseToleranceM) << "frame " << i;
  }

  const std::vector<EndedFragment> ended = tracker_->TakeEndedFragments();
  EXPECT_TRUE(tracker_->TakeEndedFragments().empty());
  ASSERT_EQ(ended.size(), 1U);
  EXPECT_EQ(ended[0].number, 0U);
  ASSERT_EQ(ended[0].trajectory.size(), kNumHere);
  for (size_t i = 0; i < kNumHere; ++i) {
    EXPECT_LT(Distance(ended[0].trajectory[i].T_session_camera, TruePose(0, i)), kPoseToleranceM) << "frame " << i;
  }
  EXPECT_EQ(tracker_->Trajectory().size(), kNumElsewhere - kNumLost + 1);
  ASSERT_FALSE(ended[0].keyframes.empty());
  for (size_t i = 0; i < ended[0].keyframes.size(); ++i) EXPECT_EQ(ended[0].keyframes[i].number, i);
  const std::vector<Keyframe> keyframes = tracker_->TakeKeyframes();
  ASSERT_FALSE(keyframes.empty());
  EXPECT_EQ(keyframes[0].number, 0U) << "a session of its own";
  EXPECT_LT(Distance(keyframes[0].T_frame_camera, Pose3()), 1e-9);
  EXPECT_EQ(tracker_->local_mapping().latency.count, ended[0].keyframes.size() + keyframes.size());
}

TEST_F(RestartTest, KeyframesHandedOutBeforeAreNotHandedOutAgain) {
  TrackHere();
  const size_t num_taken = tracker_->TakeKeyframes().size();
  ASSERT_GT(num_taken, 0U);
  TrackElsewhereUntilRestart(1);
  const std::vector<EndedFragment> ended = tracker_->TakeEndedFragments();
  ASSERT_EQ(ended.size(), 1U);
  EXPECT_TRUE(ended[0].keyframes.empty());
}

TEST_F(RestartTest, RestartsAsOftenAsItIsCarriedAway) {
  TrackHere();
  TrackElsewhereUntilRestart(1);
  TrackingResult result;
  for (size_t i = 0; i < kNumLost; ++i) result = Track(FirstRoomFrames().frames[i]);
  EXPECT_EQ(result.state, TrackingState::kTracking);
  EXPECT_EQ(result.fragment, 2U) << "the first room's map is gone: to know it again is the server's affair";
  EXPECT_EQ(tracker_->TakeEndedFragments().size(), 2U);
}

TEST_F(RestartTest, ComesBackInTimeToItsOwnMap) {
  TrackHere();
  for (size_t i = 0; i + 1 < kNumLost; ++i) ASSERT_EQ(Track(OtherRoomFrames()[i]).state, TrackingState::kLost);
  const TrackingResult back = Track(FirstRoomFrames().frames[kNumHere]);
  ASSERT_EQ(back.state, TrackingState::kTracking);
  EXPECT_EQ(back.fragment, 0U);
  EXPECT_LT(Distance(back.T_session_camera, TruePose(0, kNumHere)), kPoseToleranceM);
  EXPECT_TRUE(tracker_->TakeEndedFragments().empty());
}

TEST_F(RestartTest, DoesNotBeginAMapInTheDark) {
  TrackHere();
  SequenceFrame dark = FirstRoomFrames().frames[0];
  std::fill(dark.gray.pixels.begin(), dark.gray.pixels.end(), uint8_t{0});
  for (size_t i = 0; i < 5 * kNumLost; ++i) {
    const TrackingResult result = Track(dark);
    ASSERT_EQ(result.state, TrackingState::kLost);
    ASSERT_EQ(result.fragment, 0U);
  }
  EXPECT_EQ(Track(FirstRoomFrames().frames[kNumHere]).state, TrackingState::kTracking);
}

TEST_F(RestartTest, StaysLostWhenRestartsAreSwitchedOff) {
  options_.max_search_s = 0;
  Begin();
  TrackHere();
  for (const SequenceFrame& frame : OtherRoomFrames()) {
    const TrackingResult result = Track(frame);
    ASSERT_EQ(result.state, TrackingState::kLost);
    ASSERT_EQ(result.fragment, 0U);
  }
}

TEST_F(RestartTest, TheSharedMapOfTheFragmentBeforeIsLeftBehind) {
  TrackHere();
  const std::vector<Keyframe> keyframes = tracker_->TakeKeyframes();
  const auto map = std::make_shared<const SharedMap>(
      MakeSharedMap(keyframes, FirstRoomFrames().camera, Pose3(), /*number=*/1, /*first_id=*/100000));
  tracker_->TakeSharedMap(map);
  TrackElsewhereUntilRestart(1);
  // Asked for before the restart, it arrives after; what the device does then.
  tracker_->TakeSharedMap(map);
  tracker_->LeaveSharedMap();
  const TrackingResult result = Track(OtherRoomFrames()[kNumLost]);
  EXPECT_EQ(result.state, TrackingState::kTracking);
  EXPECT_EQ(result.shared_map_number, 0U);
  EXPECT_FALSE(result.on_shared_map);
}

TEST_F(RestartTest, RestartsWithLocalMappingInItsOwnThread) {
  options_.synchronous = false;
  Begin();
  TrackHere();
  size_t num_frames = 0;
  TrackingResult result;
  while (result.fragment == 0 && num_frames < kNumElsewhere) result = Track(OtherRoomFrames()[num_frames++]);
  ASSERT_EQ(result.fragment, 1U);
  EXPECT_EQ(result.state, TrackingState::kTracking);
  const std::vector<EndedFragment> ended = tracker_->TakeEndedFragments();
  ASSERT_EQ(ended.size(), 1U);
  EXPECT_EQ(ended[0].trajectory.size(), kNumHere);
  EXPECT_FALSE(ended[0].keyframes.empty());
}

}  // namespace
}  // namespace mapp
