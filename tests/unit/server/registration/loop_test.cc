#include "server/service/loop_closer.h"
#include "server/service/loop_correction.h"
#include "server/service/loop_graph.h"
#include "server/service/optimizer_commit.h"
#include "server/service/registrar.h"
#include "tests/unit/server/registration/map_fixture.h"
#include "tests/unit/server/registration/synthetic_room.h"

#include <gtest/gtest.h>

#include <atomic>
#include <chrono>
#include <cmath>
#include <future>
#include <map>
#include <numbers>

namespace mapp {
namespace {

using testing::EventLog;
using testing::MapFixture;
using testing::SyntheticRoom;
using testing::ViewNoise;

constexpr int kFramesOfLap = 18;
/// A landmark that comes back after so many frames without it, a tracker maps anew.
constexpr uint32_t kFramesRemembered = 4;
constexpr uint64_t kPointsOfRoom = 1'000'000;

/// What odometry adds at each step.
struct Drift {
  double step_m = 0.01;
  double step_rad = 0.0025;
};

/// A session that walks about the room, with odometry that drifts and a tracker that forgets.
class DriftingWalk {
 public:
  DriftingWalk(MapFixture& fixture, const SyntheticRoom& room, SessionId session, const Drift& drift)
      : fixture_(fixture), room_(room), session_(session), drift_(drift) {}

  /// Stores the next keyframe, taken at `T_world_camera`.
  FrameId Step(const Pose3& T_world_camera) {
    if (truth_.empty()) {
      T_session_camera_ = Pose3();
    } else {
      const Pose3 slip(Eigen::Quaterniond::Identity(), {drift_.step_m, 0, 0});
      const Pose3 turn(Eigen::Quaterniond(Eigen::AngleAxisd(drift_.step_rad, Eigen::Vector3d::UnitY())),
                       Eigen::Vector3d::Zero());
      T_session_camera_ = slip * T_session_camera_ * (truth_.back().Inverse() * T_world_camera) * turn;
    }
    const auto number = static_cast<uint32_t>(truth_.size());
    truth_.push_back(T_world_camera);
    Keyframe keyframe = room_.View(T_world_camera, T_world_camera, session_, number, ViewNoise(), rng_);
    keyframe.T_frame_camera = T_session_camera_;
    for (KeyframeFeature& feature : keyframe.features) feature.point->id = NumberOf(feature.point->id, number);
    return fixture_.Store(session_, keyframe);
  }

  const std::vector<Pose3>& truth() const { return truth_; }

 private:
  struct Landmark {
    uint32_t last_seen = 0;
    uint64_t times_mapped = 0;
  };

  uint64_t NumberOf(uint64_t landmark_number, uint32_t frame) {
    const auto [known, is_new] = landmarks_.try_emplace(landmark_number, Landmark{frame, 0});
    Landmark& landmark = known->second;
    if (frame - landmark.last_seen > kFramesRemembered) ++landmark.times_mapped;
    landmark.last_seen = frame;
    return landmark_number + landmark.times_mapped * kPointsOfRoom;
  }

  MapFixture& fixture_;
  const SyntheticRoom& room_;
  const SessionId session_;
  const Drift drift_;
  Rng rng_{7};
  std::vector<Pose3> truth_;
  Pose3 T_session_camera_;
  std::map<uint64_t, Landmark> landmarks_;
};

class LoopTest : public ::testing::Test {
 protected:
  LoopTest() {
    RegistrarOptions options;
    options.on_error = [](SessionId, const Status& status) { ADD_FAILURE() << status; };
    options.on_loop_closed = [this](SessionId, const ClosedLoop& loop) {
      if (num_closed_++ == 0) first_closed_.set_value(loop);
    };
    registrar_ = std::make_unique<Registrar>(fixture_.store(), fixture_.tiles(), fixture_.events(), options);
  }
  ~LoopTest() override { registrar_->Shutdown(); }

  SessionId OpenSession(bool founder) { return fixture_.OpenSession(SyntheticRoom::DeviceCamera(), founder); }

  static std::vector<Pose3> Laps(int num_frames) {
    return SyntheticRoom::Circle(0.5, 0, 2 * std::numbers::pi / kFramesOfLap, num_frames);
  }
  /// What the first loop changed, once that is done; the registrar does nothing more then.
  std::optional<ClosedLoop> WaitForLoop() {
    std::future<ClosedLoop> closed = first_closed_.get_future();
    if (closed.wait_for(std::chrono::seconds(30)) != std::future_status::ready) return std::nullopt;
    registrar_->Shutdown();
    return closed.get();
  }
  void Tell(SessionId session, FrameId frame) {
    const bool in_map = fixture_.Session(session).T_map_session.has_value();
    registrar_->OnKeyframeStored(fixture_.map(), session, frame, in_map);
  }
  /// How far the map has the session's frame from where it is, the first frame's pose being the map's. Metres.
  double ErrorOf(SessionId session, const DriftingWalk& walk, size_t number) {
    const Pose3 T_map_world = founder_origin_.Inverse();
    return Distance(fixture_.Frames(session)[number].T_frame_camera, T_map_world * walk.truth()[number]);
  }

  MapFixture fixture_;
  SyntheticRoom room_{1};
  Pose3 founder_origin_ = Laps(1).front();
  std::atomic<int> num_closed_ = 0;
  std::promise<ClosedLoop> first_closed_;
  std::unique_ptr<Registrar> registrar_;
};

TEST_F(LoopTest, ASessionThatComesBackIsCorrectedOverItsWay) {
  const SessionId session = OpenSession(/*founder=*/true);
  EventLog log(fixture_, session);
  DriftingWalk walk(fixture_, room_, session, {});
  std::vector<FrameId> frames;
  const std::vector<Pose3> poses = Laps(kFramesOfLap + 5);
  for (const Pose3& pose : poses) frames.push_back(walk.Step(pose));
  const double before_end_m = ErrorOf(session, walk, poses.size() - 1);
  const double before_middle_m = ErrorOf(session, walk, kFramesOfLap - 4);
  ASSERT_GT(before_end_m, 0.15);
  for (const FrameId frame : frames) Tell(session, frame);

  const auto corrected = log.WaitFor<SessionCorrected>(0);
  ASSERT_TRUE(corrected);
  const auto closed = WaitForLoop();
  ASSERT_TRUE(closed);
  EXPECT_GT(closed->max_motion_m, 0.1);
  EXPECT_LT(ErrorOf(session, walk, 0), 1e-9) << "the map's frame stays";
  EXPECT_LT(ErrorOf(session, walk, poses.size() - 1), 0.25 * before_end_m);
  EXPECT_LT(ErrorOf(session, walk, kFramesOfLap - 4), 0.5 * before_middle_m) << "spread over the way";
  ASSERT_TRUE(fixture_.Session(session).T_map_session);
  EXPECT_LT(Distance(*fixture_.Session(session).T_map_session, corrected->T_map_session), 1e-9);

  // The next keyframe is where the corrected ones are.
  const Pose3 next = Laps(kFramesOfLap + 6).back();
  walk.Step(next);
  EXPECT_LT(ErrorOf(session, walk, poses.size()), 0.3 * before_end_m);
}

TEST_F(LoopTest, WhatTheVisitShowsTwiceIsFused) {
  const SessionId session = OpenSession(/*founder=*/true);
  EventLog log(fixture_, session);
  DriftingWalk walk(fixture_, room_, session, {});
  std::vector<FrameId> frames;
  for (const Pose3& pose : Laps(kFramesOfLap + 5)) frames.push_back(walk.Step(pose));
  const auto before = fixture_.Read()->PointsOfSession(session);
  ASSERT_TRUE(before.ok()) << before.status();
  for (const FrameId frame : frames) Tell(session, frame);
  const auto closed = WaitForLoop();
  ASSERT_TRUE(closed);
  EXPECT_GT(closed->num_fused, 0U);

  const auto after = fixture_.Read()->PointsOfSession(session);
  ASSERT_TRUE(after.ok()) << after.status();
  const auto num_double = [](const std::vector<PointRecord>& points) {
    std::map<uint64_t, int> counts;
    for (const PointRecord& point : points) ++counts[point.session_point % kPointsOfRoom];
    return std::ranges::count_if(counts, [](const auto& entry) { return entry.second > 1; });
  };
  EXPECT_LT(num_double(*after), num_double(*before) / 2);
}

TEST_F(LoopTest, WhoWasAlignedAlongTheWayGoesWithIt) {
  const SessionId session = OpenSession(/*founder=*/true);
  EventLog log(fixture_, session);
  DriftingWalk walk(fixture_, room_, session, {});
  const std::vector<Pose3> poses = Laps(kFramesOfLap + 5);
  for (int i = 0; i < kFramesOfLap - 2; ++i) Tell(session, walk.Step(poses[i]));

  // A guest joins where the founder has drifted.
  const SessionId guest = OpenSession(/*founder=*/false);
  EventLog guest_log(fixture_, guest);
  DriftingWalk guest_walk(fixture_, room_, guest, {.step_m = 0, .step_rad = 0});
  for (const Pose3& pose : SyntheticRoom::Circle(0.6, 4.2, 0.12, 6)) Tell(guest, guest_walk.Step(pose));
  ASSERT_TRUE(guest_log.WaitFor<SessionAligned>(0));
  const double guest_before_m = ErrorOf(guest, guest_walk, 3);
  ASSERT_GT(guest_before_m, 0.08);

  for (size_t i = kFramesOfLap - 2; i < poses.size(); ++i) Tell(session, walk.Step(poses[i]));
  ASSERT_TRUE(log.WaitFor<SessionCorrected>(0));
  ASSERT_TRUE(guest_log.WaitFor<SessionCorrected>(0));
  ASSERT_TRUE(WaitForLoop());
  EXPECT_LT(ErrorOf(guest, guest_walk, 3), 0.6 * guest_before_m);
}

TEST_F(LoopTest, ASessionThatDidNotDriftStaysWhereItIs) {
  const SessionId session = OpenSession(/*founder=*/true);
  EventLog log(fixture_, session);
  DriftingWalk walk(fixture_, room_, session, {.step_m = 0, .step_rad = 0});
  const std::vector<Pose3> poses = Laps(2 * kFramesOfLap);
  for (const Pose3& pose : poses) Tell(session, walk.Step(pose));
  // A fragment's keyframe is answered when it has been looked at, and with it all that came before.
  const SessionId stranger = OpenSession(/*founder=*/false);
  EventLog stranger_log(fixture_, stranger);
  DriftingWalk elsewhere(fixture_, room_, stranger, {});
  Tell(stranger, elsewhere.Step(poses.front()));
  ASSERT_TRUE(stranger_log.WaitFor<AlignmentTried>(0));
  EXPECT_EQ(log.Count<SessionCorrected>(), 0U);
  EXPECT_LT(ErrorOf(session, walk, poses.size() - 1), 1e-9);
}

TEST_F(LoopTest, FurtherAwayThanOdometryDriftsIsNoLoop) {
  const SessionId session = OpenSession(/*founder=*/true);
  EventLog log(fixture_, session);
  DriftingWalk walk(fixture_, room_, session, {.step_m = 0.08, .step_rad = 0});
  const std::vector<Pose3> poses = Laps(kFramesOfLap + 5);
  for (const Pose3& pose : poses) Tell(session, walk.Step(pose));
  const SessionId stranger = OpenSession(/*founder=*/false);
  EventLog stranger_log(fixture_, stranger);
  DriftingWalk elsewhere(fixture_, room_, stranger, {});
  Tell(stranger, elsewhere.Step(poses[9]));
  ASSERT_TRUE(stranger_log.WaitFor<AlignmentTried>(0));
  EXPECT_EQ(log.Count<SessionCorrected>(), 0U);
}

TEST_F(LoopTest, WhatCameMeanwhileGoesAlongWhereverItIs) {
  const SessionId session = OpenSession(/*founder=*/true);
  DriftingWalk walk(fixture_, room_, session, {});
  for (const Pose3& pose : Laps(kFramesOfLap)) walk.Step(pose);
  const std::vector<FrameRecord> frames = fixture_.Frames(session);
  const Loop loop{fixture_.map(), {session, frames.back().number, frames.back().number}, {}};
  const auto graph = LoadLoopGraph({}, *fixture_.Read(), loop);
  ASSERT_TRUE(graph.ok()) << graph.status();

  const FrameId arrived = walk.Step(SyntheticRoom::Stand(2.9, 0, -std::numbers::pi / 2));
  const auto before = fixture_.Read()->GetFrame(arrived);
  ASSERT_TRUE(before.ok()) << before.status();
  const Eigen::Vector3d& center = before->T_frame_camera.translation();
  const Pose3 shift(Eigen::Quaterniond::Identity(), {0, 0, 0.1});
  BundleProblem adjusted = graph->region.problem;
  for (BundleProblem::Frame& frame : adjusted.frames) {
    if (!frame.fixed) frame.T_world_camera = shift * frame.T_world_camera;
  }
  const std::vector<bool> no_outliers;
  OptimizerCommit commit(graph->region, adjusted, no_outliers);
  const Status committed = fixture_.store().Write({}, [&](MapWriter& writer) { return commit.Run(writer); });
  ASSERT_TRUE(committed.ok()) << committed;
  const auto after = fixture_.Read()->GetFrame(arrived);
  ASSERT_TRUE(after.ok()) << after.status();
  EXPECT_LT((after->T_frame_camera.translation() - center - shift.translation()).norm(), 1e-9);
}

TEST_F(LoopTest, ALoopThatTheWayContradictsChangesNothing) {
  const SessionId session = OpenSession(/*founder=*/true);
  EventLog log(fixture_, session);
  DriftingWalk walk(fixture_, room_, session, {});
  for (const Pose3& pose : Laps(kFramesOfLap)) walk.Step(pose);
  const std::vector<FrameRecord> before = fixture_.Frames(session);
  const FrameRecord& last = before.back();
  const Pose3 T_anchor_frame =
      before.front().T_frame_camera.Inverse() * last.T_frame_camera * Pose3(Eigen::Quaterniond::Identity(), {3, 0, 0});
  const Loop loop{fixture_.map(), {session, last.number, last.number}, {{before.front().id, last.id, T_anchor_frame}}};
  const auto closed = CloseLoop(fixture_.store(), fixture_.tiles(), fixture_.events(), {}, loop);
  ASSERT_TRUE(closed.ok()) << closed.status();
  EXPECT_FALSE(closed->has_value());
  const std::vector<FrameRecord> after = fixture_.Frames(session);
  for (size_t i = 0; i < before.size(); ++i) {
    EXPECT_EQ(Distance(before[i].T_frame_camera, after[i].T_frame_camera), 0) << i;
  }
  EXPECT_EQ(log.Count<SessionCorrected>(), 0U);
}

}  // namespace
}  // namespace mapp
