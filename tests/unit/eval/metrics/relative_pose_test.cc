#include "eval/metrics/trajectory_metrics.h"
#include "mapp/base/rng.h"
#include "tests/unit/eval/metrics/trajectories.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <numbers>

namespace mapp {
namespace {

constexpr double kPoseTolerance = 1e-9;

Pose3 AnotherFrame() { return Pose3(ExpSo3({0.3, -0.5, 1.2}), {4.0, -2.0, 0.5}); }

TEST(RelativePoseErrorTest, TheFrameOfATrajectoryDoesNotMatter) {
  const auto truth = Curve(50);
  const auto error = RelativePoseErrorOverTime(truth, Moved(AnotherFrame(), 1.0, truth), 1.0);
  ASSERT_TRUE(error.ok()) << error.status();
  EXPECT_EQ(error->num_pairs(), 40);
  EXPECT_NEAR(error->translation_m.max, 0, kPoseTolerance);
  EXPECT_NEAR(error->rotation_rad.max, 0, 1e-7);
}

TEST(RelativePoseErrorTest, DriftIsTheRateTimesTheDelta) {
  // 1.2 m/s of true motion, of which the estimate makes 1.25 m/s: 5 cm more each second.
  const auto truth = Straight(101, 1.2);
  const auto estimate = Straight(101, 1.25);
  for (const double delta_s : {0.5, 1.0, 2.0}) {
    const auto error = RelativePoseErrorOverTime(truth, estimate, delta_s);
    ASSERT_TRUE(error.ok()) << error.status();
    EXPECT_NEAR(error->translation_m.rms, 0.05 * delta_s, kPoseTolerance);
    EXPECT_NEAR(error->translation_m.max, 0.05 * delta_s, kPoseTolerance);
    EXPECT_NEAR(error->rotation_rad.max, 0, 1e-7);
  }
}

TEST(RelativePoseErrorTest, DistanceIsMeasuredAlongTheTruePath) {
  const auto truth = Straight(101, 1.0);
  const auto error = RelativePoseErrorOverDistance(truth, Moved(Pose3(), 1.02, truth), 5.0);
  ASSERT_TRUE(error.ok()) << error.status();
  EXPECT_EQ(error->num_pairs(), 51);
  EXPECT_NEAR(error->translation_m.mean, 0.02 * 5.0, kPoseTolerance);
}

TEST(RelativePoseErrorTest, TurningTooFarShowsAsRotation) {
  const auto truth = Straight(60, 1.0);
  auto estimate = truth;
  const double drift_rad_s = 2 * std::numbers::pi / 180;
  for (size_t i = 0; i < estimate.size(); ++i) {
    const double angle = drift_rad_s * 0.1 * static_cast<double>(i);
    estimate[i].T_world_camera = Pose3(ExpSo3({0, 0, angle}), truth[i].T_world_camera.translation());
  }
  const auto error = RelativePoseErrorOverTime(truth, estimate, 1.0);
  ASSERT_TRUE(error.ok()) << error.status();
  EXPECT_NEAR(error->rotation_rad.median, drift_rad_s, 1e-7);
  EXPECT_NEAR(error->rotation_rad.rms, drift_rad_s, 1e-7);
}

TEST(RelativePoseErrorTest, OneJumpHurtsOnlyThePairsAcrossIt) {
  // A jump of 1 m after 5 s: the ATE of the whole shows it, the relative error only over the second across it.
  const auto truth = Straight(101, 1.0);
  auto estimate = truth;
  for (size_t i = 50; i < estimate.size(); ++i) {
    estimate[i].T_world_camera = Pose3(Eigen::Quaterniond::Identity(), {0, 1, 0}) * estimate[i].T_world_camera;
  }
  const auto error = RelativePoseErrorOverTime(truth, estimate, 1.0);
  ASSERT_TRUE(error.ok()) << error.status();
  EXPECT_EQ(error->num_pairs(), 91);
  EXPECT_NEAR(error->translation_m.max, 1.0, kPoseTolerance);
  EXPECT_NEAR(error->translation_m.median, 0, kPoseTolerance);
  EXPECT_NEAR(error->translation_m.mean, 10.0 / 91, kPoseTolerance);
}

TEST(RelativePoseErrorTest, GapsAreNotBridgedByPairsOfAnotherLength) {
  const auto truth = Straight(100, 1.0);
  auto estimate = truth;
  estimate.erase(estimate.begin() + 20, estimate.begin() + 80);
  const auto error = RelativePoseErrorOverTime(truth, estimate, 0.5);
  ASSERT_TRUE(error.ok()) << error.status();
  EXPECT_EQ(error->num_pairs(), 15 + 15);  // 20 poses on either side
}

TEST(RelativePoseErrorTest, RefusesADeltaThatNoPairHas) {
  const auto truth = Straight(20, 1.0);
  for (const double delta : {0.0, -1.0, 100.0, std::nan("")}) {
    EXPECT_EQ(RelativePoseErrorOverTime(truth, truth, delta).status().code(), absl::StatusCode::kInvalidArgument);
    EXPECT_EQ(RelativePoseErrorOverDistance(truth, truth, delta).status().code(), absl::StatusCode::kInvalidArgument);
  }
  EXPECT_FALSE(RelativePoseErrorOverDistance(Straight(20, 0), truth, 1.0).ok());
  EXPECT_FALSE(RelativePoseErrorOverTime({}, truth, 1.0).ok());
}

}  // namespace
}  // namespace mapp
