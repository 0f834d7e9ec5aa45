#include "cli/session_track.h"

#include <gtest/gtest.h>

namespace mapp {
namespace {

constexpr int64_t kSecondNs = 1'000'000'000;

Pose3 At(double x) { return Pose3(Eigen::Quaterniond::Identity(), {x, 0, 0}); }

TEST(SessionTrackTest, DrawsASessionWithoutALogByItsKeyframes) {
  const auto tracks = MakeTracks({{1, 0, 0, At(0), false}, {1, 1, 60 * kSecondNs, At(1), true}}, {}, {});
  ASSERT_EQ(tracks.size(), 1);
  EXPECT_EQ(tracks[0].label, "session 1");
  EXPECT_EQ(tracks[0].CountMarks(FrameMark::kWhole), 1);
  EXPECT_EQ(tracks[0].CountMarks(FrameMark::kPartial), 1);
  EXPECT_TRUE(tracks[0].IsContinuous(1)) << "keyframes may be far apart in time";
}

TEST(SessionTrackTest, JoinsLogAndKeyframesByTime) {
  FrameLog log{2, {}};
  log.frames.push_back({0, At(0), false, FrameRole::kKeyframe});
  log.frames.push_back({kSecondNs / 10, At(1), false, FrameRole::kOrdinary});
  log.frames.push_back({kSecondNs / 5, At(2), true, FrameRole::kSharedKeyframe});
  SessionSummary session;
  session.id = 2;
  session.device = "drone";
  const auto tracks = MakeTracks({{2, 0, 0, At(0.5), true}}, {log}, {session});

  ASSERT_EQ(tracks.size(), 1);
  EXPECT_EQ(tracks[0].label, "2: drone");
  ASSERT_EQ(tracks[0].frames.size(), 3);
  EXPECT_EQ(tracks[0].frames[0].mark, FrameMark::kPartial) << "as the map has it";
  EXPECT_EQ(tracks[0].frames[0].T_map_camera.translation().x(), 0.5) << "at the map's pose";
  EXPECT_EQ(tracks[0].frames[1].mark, FrameMark::kNone);
  EXPECT_EQ(tracks[0].frames[2].mark, FrameMark::kShared);
  EXPECT_TRUE(tracks[0].frames[2].on_shared_map);
}

TEST(SessionTrackTest, BreaksALoggedTrackWhereFramesAreMissing) {
  FrameLog log{1, {}};
  log.frames.push_back({0, At(0), false, FrameRole::kOrdinary});
  log.frames.push_back({kSecondNs / 10, At(0), false, FrameRole::kOrdinary});
  log.frames.push_back({5 * kSecondNs, At(9), false, FrameRole::kOrdinary});
  const auto tracks = MakeTracks({}, {log}, {});
  ASSERT_EQ(tracks.size(), 1);
  EXPECT_TRUE(tracks[0].IsContinuous(1));
  EXPECT_FALSE(tracks[0].IsContinuous(2));
}

}  // namespace
}  // namespace mapp
