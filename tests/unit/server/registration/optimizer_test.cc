#include "server/service/optimizer.h"

#include "tests/unit/server/registration/map_fixture.h"
#include "tests/unit/server/registration/synthetic_room.h"

#include <gtest/gtest.h>

#include <cmath>
#include <numbers>
#include <set>

namespace mapp {
namespace {

using testing::EventLog;
using testing::MapFixture;
using testing::SyntheticRoom;
using testing::ViewNoise;

class OptimizerTest : public ::testing::Test {
 protected:
  OptimizerTest() { StartOptimizer(OptimizerOptions()); }
  ~OptimizerTest() override { optimizer_->Shutdown(); }

  void StartOptimizer(OptimizerOptions options) {
    options.num_threads = 1;
    options.on_error = [](SessionId, const Status& status) { ADD_FAILURE() << status; };
    optimizer_ = std::make_unique<Optimizer>(fixture_.store(), fixture_.tiles(), fixture_.events(), options);
  }

  /// Stores a founding session whose pose estimates are off the truth by noise of `sigma_m` (and as much in tens of
  /// degrees), the first one excepted.
  SessionId Walk(int num_keyframes, double sigma_m) {
    const SessionId session = fixture_.OpenSession(SyntheticRoom::DeviceCamera(), /*founder=*/true);
    poses_ = SyntheticRoom::Circle(0.5, 0, 0.15, num_keyframes);
    for (size_t i = 0; i < poses_.size(); ++i) {
      Keyframe keyframe = room_.View(poses_[i], poses_.front(), session, static_cast<uint32_t>(i), ViewNoise(), rng_);
      Eigen::Matrix<double, 6, 1> error = Eigen::Matrix<double, 6, 1>::Zero();
      if (i > 0) {
        for (int k = 0; k < 6; ++k) error[k] = (k < 3 ? 1.0 : 0.2) * sigma_m * rng_.Normal();
      }
      keyframe.T_frame_camera = keyframe.T_frame_camera * Pose3::Exp(error);
      fixture_.Store(session, keyframe);
    }
    fixture_.CloseSession(session);
    return session;
  }

  double PoseRmseM(SessionId session) {
    double sum = 0;
    const std::vector<FrameRecord> frames = fixture_.Frames(session);
    for (const FrameRecord& frame : frames) {
      const Pose3 expected = poses_.front().Inverse() * poses_[frame.number];
      sum += std::pow(Distance(frame.T_frame_camera, expected), 2);
    }
    return std::sqrt(sum / static_cast<double>(frames.size()));
  }

  MapFixture fixture_;
  std::unique_ptr<Optimizer> optimizer_;
  SyntheticRoom room_{1};
  Rng rng_{3};
  std::vector<Pose3> poses_;
};

TEST_F(OptimizerTest, BringsPerturbedPosesBack) {
  const SessionId session = Walk(10, 0.03);
  const double before_m = PoseRmseM(session);
  const auto finished = optimizer_->OptimizeSession({}, session);
  ASSERT_TRUE(finished.ok()) << finished.status();
  EXPECT_TRUE(finished->applied);
  EXPECT_LT(finished->final_rmse_px, 1.0);
  EXPECT_LT(finished->final_rmse_px, finished->initial_rmse_px);
  EXPECT_EQ(finished->num_frames, 9U) << "the first frame holds the gauge";
  EXPECT_GT(finished->num_points, 100U);
  EXPECT_LT(PoseRmseM(session), 0.25 * before_m);
  EXPECT_TRUE(fixture_.Session(session).optimized);
}

/// What partial keyframes come to where the map knows much: of the points of the frames before, the later ones keep a
/// handful, matched a little falsely.
TEST_F(OptimizerTest, FramesThatShareNextToNothingWithTheRestStayWithTheirOdometry) {
  const SessionId session = fixture_.OpenSession(SyntheticRoom::DeviceCamera(), /*founder=*/true);
  constexpr size_t kFirstLate = 5;
  constexpr int kKept = 4;
  poses_ = SyntheticRoom::Circle(0.5, 0, 0.1, 10);
  std::set<uint64_t> early;
  for (size_t i = 0; i < poses_.size(); ++i) {
    Keyframe keyframe = room_.View(poses_[i], poses_.front(), session, static_cast<uint32_t>(i), ViewNoise(), rng_);
    if (i < kFirstLate) {
      for (const KeyframeFeature& feature : keyframe.features) early.insert(feature.point->id);
    } else {
      keyframe.partial = true;
      int num_kept = 0;
      std::erase_if(keyframe.features, [&](KeyframeFeature& feature) {
        if (!early.contains(feature.point->id)) return false;
        feature.keypoint.u_px += 4;
        return ++num_kept > kKept;
      });
    }
    fixture_.Store(session, keyframe);
  }
  fixture_.CloseSession(session);
  const auto finished = optimizer_->OptimizeSession({}, session);
  ASSERT_TRUE(finished.ok()) << finished.status();
  EXPECT_TRUE(finished->applied);
  EXPECT_LT(PoseRmseM(session), 0.005);
}

TEST_F(OptimizerTest, KeepsTheFirstFrameWhereItIs) {
  const SessionId session = Walk(6, 0.03);
  ASSERT_TRUE(optimizer_->OptimizeSession({}, session).ok());
  EXPECT_LT(Distance(fixture_.Frames(session).front().T_frame_camera, Pose3()), 1e-9);
}

TEST_F(OptimizerTest, LeavesAGoodMapAsGood) {
  const SessionId session = Walk(10, 0.0);
  const double before_m = PoseRmseM(session);
  const auto finished = optimizer_->OptimizeSession({}, session);
  ASSERT_TRUE(finished.ok()) << finished.status();
  EXPECT_LE(finished->final_rmse_px, finished->initial_rmse_px);
  EXPECT_LT(PoseRmseM(session), before_m + 0.005);
}

TEST_F(OptimizerTest, DropsAResultThatTearsFramesAway) {
  // Poses so wrong that the adjustment, if it holds at all, has to move them by more than it may.
  const SessionId session = Walk(5, 0.0);
  const std::vector<FrameRecord> before = fixture_.Frames(session);
  const Pose3 far(Eigen::Quaterniond::Identity(), {0.8, 0, 0});
  const Status moved = fixture_.store().Write({}, [&](MapWriter& writer) {
    return writer.SetFramePose(before[2].id, /*in_map=*/true, before[2].T_frame_camera * far);
  });
  ASSERT_TRUE(moved.ok()) << moved;
  const auto finished = optimizer_->OptimizeSession({}, session);
  ASSERT_TRUE(finished.ok()) << finished.status();
  EXPECT_FALSE(finished->applied);
  const std::vector<FrameRecord> after = fixture_.Frames(session);
  EXPECT_EQ(after[1].T_frame_camera.translation(), before[1].T_frame_camera.translation());
  EXPECT_TRUE(fixture_.Session(session).optimized) << "tried and dropped is not owed any more";
}

TEST_F(OptimizerTest, RunsWhenASessionClosesAndTells) {
  const SessionId session = Walk(6, 0.02);
  EventLog log(fixture_, session);
  optimizer_->OnSessionClosed(session);
  const auto finished = log.WaitFor<OptimizationFinished>(0);
  ASSERT_TRUE(finished);
  EXPECT_TRUE(finished->applied);
  EXPECT_EQ(log.Count<TilesChanged>(), 1U);
}

TEST_F(OptimizerTest, ResumesWhatIsOwed) {
  const SessionId owed = Walk(5, 0.02);
  EventLog log(fixture_, owed);
  ASSERT_TRUE(optimizer_->ResumeOwed().ok());
  ASSERT_TRUE(log.WaitFor<OptimizationFinished>(0));
  // Done now: asking again queues nothing, so a fragment's run after it is the next to finish.
  ASSERT_TRUE(optimizer_->ResumeOwed().ok());
  optimizer_->Shutdown();
  EXPECT_EQ(log.Count<OptimizationFinished>(), 1U);
}

TEST_F(OptimizerTest, LongSessionsGoInStretches) {
  OptimizerOptions options;
  options.max_free_frames = 8;
  StartOptimizer(options);
  const SessionId session = Walk(12, 0.02);
  const double before_m = PoseRmseM(session);
  const auto finished = optimizer_->OptimizeSession({}, session);
  ASSERT_TRUE(finished.ok()) << finished.status();
  EXPECT_TRUE(finished->applied);
  EXPECT_LT(PoseRmseM(session), before_m);
}

TEST_F(OptimizerTest, FragmentsAreLeftAlone) {
  const SessionId session = fixture_.OpenSession(SyntheticRoom::DeviceCamera(), /*founder=*/false);
  const Pose3 pose = SyntheticRoom::Stand(0, 0, 0);
  fixture_.Store(session, room_.View(pose, pose, session, 0, ViewNoise(), rng_));
  const auto finished = optimizer_->OptimizeSession({}, session);
  ASSERT_TRUE(finished.ok()) << finished.status();
  EXPECT_FALSE(finished->applied);
  EXPECT_FALSE(fixture_.Session(session).optimized);
}

TEST_F(OptimizerTest, CancelledWorkChangesNothingAndStaysOwed) {
  const SessionId session = Walk(6, 0.02);
  const double before_m = PoseRmseM(session);
  CallContext context;
  context.is_cancelled = [] { return true; };
  EXPECT_EQ(optimizer_->OptimizeSession(context, session).status().code(), absl::StatusCode::kCancelled);
  EXPECT_EQ(PoseRmseM(session), before_m);
  EXPECT_FALSE(fixture_.Session(session).optimized);
}

TEST_F(OptimizerTest, AWholeMapIsAdjustedAtOnceAndTellsHowFarItIs) {
  OptimizerOptions options;
  options.max_free_frames = 4;  // bounds what a session's optimisation may touch, not this
  StartOptimizer(options);
  const SessionId session = Walk(12, 0.03);
  const double before_m = PoseRmseM(session);
  std::vector<MapOptimizationProgress> told;
  const auto finished =
      optimizer_->OptimizeMap({}, fixture_.map(), [&told](const auto& progress) { told.push_back(progress); });
  ASSERT_TRUE(finished.ok()) << finished.status();
  EXPECT_TRUE(finished->adjustment.applied);
  EXPECT_EQ(finished->adjustment.num_frames, 11U) << "the first frame holds the gauge";
  EXPECT_LT(finished->adjustment.final_rmse_px, 1.0);
  // The poses' noise, independent from one to the next, is ten times what the adjustment takes for odometry's.
  EXPECT_LT(PoseRmseM(session), 0.25 * before_m);
  EXPECT_EQ(finished->num_fused, 0U) << "nothing in this map is double";
  EXPECT_EQ(finished->num_rounds, 1U);
  ASSERT_GT(told.size(), 3U);
  EXPECT_EQ(told.front().num_iterations, 0U);
  EXPECT_EQ(told.front().num_frames, 11U);
  EXPECT_EQ(told[1].num_iterations, 1U);
  EXPECT_LT(told[2].cost, told[1].cost);
}

TEST_F(OptimizerTest, AWholeMapsOptimizationIsCancelledInItsMidst) {
  const SessionId session = Walk(8, 0.03);
  const double before_m = PoseRmseM(session);
  bool adjusting = false;
  CallContext context;
  context.is_cancelled = [&adjusting] { return adjusting; };
  const auto finished = optimizer_->OptimizeMap(
      context, fixture_.map(), [&adjusting](const auto& progress) { adjusting = progress.num_iterations >= 1; });
  EXPECT_EQ(finished.status().code(), absl::StatusCode::kCancelled);
  EXPECT_TRUE(adjusting);
  EXPECT_EQ(PoseRmseM(session), before_m);
}

TEST_F(OptimizerTest, UnknownMapIsNotFound) {
  EXPECT_EQ(optimizer_->OptimizeMap({}, MapId(77), {}).status().code(), absl::StatusCode::kNotFound);
}

TEST_F(OptimizerTest, UnknownSessionIsNotFound) {
  EXPECT_EQ(optimizer_->OptimizeSession({}, SessionId(77)).status().code(), absl::StatusCode::kNotFound);
}

}  // namespace
}  // namespace mapp
