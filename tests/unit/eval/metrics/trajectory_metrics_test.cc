#include "eval/metrics/trajectory_metrics.h"

#include "mapp/base/rng.h"
#include "tests/unit/eval/metrics/trajectories.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <cmath>

namespace mapp {
namespace {

constexpr double kTolerance_m = 1e-9;

Pose3 SomePose() { return Pose3(ExpSo3({0.3, -0.5, 1.2}), {4.0, -2.0, 0.5}); }

TEST(TrajectoryErrorTest, RigidMotionIsAlignedAway) {
  const auto truth = Curve(40);
  const auto error = AbsoluteTrajectoryError(truth, Moved(SomePose(), 1.0, truth), false);
  ASSERT_TRUE(error.ok()) << error.status();
  EXPECT_NEAR(error->rmse_m, 0, kTolerance_m);
  EXPECT_EQ(error->num_paired, 40);
  EXPECT_DOUBLE_EQ(error->T_truth_estimate.scale, 1.0);
  EXPECT_NEAR(Distance(error->T_truth_estimate.pose * SomePose(), Pose3()), 0, kTolerance_m);
}

TEST(TrajectoryErrorTest, ScaleIsAlignedAwayOnlyWhenAsked) {
  const auto truth = Curve(40);
  const auto estimate = Moved(SomePose(), 0.5, truth);
  const auto with_scale = AbsoluteTrajectoryError(truth, estimate, true);
  ASSERT_TRUE(with_scale.ok()) << with_scale.status();
  EXPECT_NEAR(with_scale->rmse_m, 0, kTolerance_m);
  EXPECT_NEAR(with_scale->T_truth_estimate.scale, 2.0, kTolerance_m);
  EXPECT_GT(AbsoluteTrajectoryError(truth, estimate, false)->rmse_m, 0.1);
}

TEST(TrajectoryErrorTest, UnderAGivenAlignmentNothingIsFitted) {
  const auto truth = Curve(40);
  const auto estimate = Moved(Pose3(Eigen::Quaterniond::Identity(), {0, 0.3, 0.4}), 1.0, truth);
  const auto error = TrajectoryErrorUnder(Sim3(), truth, estimate);
  ASSERT_TRUE(error.ok()) << error.status();
  EXPECT_NEAR(error->rmse_m, 0.5, kTolerance_m);
  EXPECT_NEAR(error->mean_m, 0.5, kTolerance_m);
  EXPECT_NEAR(error->max_m, 0.5, kTolerance_m);
}

TEST(TrajectoryErrorTest, SecondSessionIsJudgedUnderTheFirstOnesAlignment) {
  // Both sessions are exact in a map whose frame is another; the second one is off by 0.2 m in that map.
  const auto truth = Curve(60);
  const std::vector<StampedPose> truth_1(truth.begin() + 30, truth.end());
  auto estimate_0 = Moved(SomePose(), 1.0, {truth.begin(), truth.begin() + 30});
  auto estimate_1 = Moved(Pose3(Eigen::Quaterniond::Identity(), {0.2, 0, 0}) * SomePose(), 1.0, truth_1);
  const auto first = AbsoluteTrajectoryError(truth, estimate_0, false);
  ASSERT_TRUE(first.ok()) << first.status();
  const auto second = TrajectoryErrorUnder(first->T_truth_estimate, truth_1, estimate_1);
  ASSERT_TRUE(second.ok()) << second.status();
  EXPECT_NEAR(second->rmse_m, 0.2, 1e-6);
  EXPECT_NEAR(AbsoluteTrajectoryError(truth_1, estimate_1, false)->rmse_m, 0, 1e-6);
}

TEST(TrajectoryErrorTest, TogetherOneAlignmentHasToSuitAll) {
  const auto truth = Curve(60);
  const Pose3 shift(Eigen::Quaterniond::Identity(), {0, 0, 0.2});
  const auto exact = Moved(SomePose(), 1.0, truth);
  const auto shifted = Moved(SomePose() * shift, 1.0, truth);
  const auto same = TogetherTrajectoryError({{truth, exact}, {truth, exact}});
  ASSERT_TRUE(same.ok()) << same.status();
  EXPECT_NEAR(same->rmse_m, 0, kTolerance_m);
  EXPECT_EQ(same->num_paired, 120);
  // Each is exact for itself, but they lie 0.2 m apart: the best that one alignment can do is half of it to each.
  const auto apart = TogetherTrajectoryError({{truth, exact}, {truth, shifted}});
  ASSERT_TRUE(apart.ok()) << apart.status();
  EXPECT_NEAR(apart->rmse_m, 0.1, kTolerance_m);
  EXPECT_EQ(TogetherTrajectoryError({}).status().code(), absl::StatusCode::kInvalidArgument);
  EXPECT_EQ(TogetherTrajectoryError({{truth, exact}, {truth, {}}}).status().code(), absl::StatusCode::kInvalidArgument);
}

TEST(TrajectoryErrorTest, MeasuresKnownDeviations) {
  const auto truth = Curve(4);
  auto estimate = truth;
  const double offsets_m[] = {0.0, 0.1, 0.2, 0.4};
  for (size_t i = 0; i < 4; ++i) {
    estimate[i].T_world_camera = Pose3(Eigen::Quaterniond::Identity(), {0, 0, offsets_m[i]}) * truth[i].T_world_camera;
  }
  const auto error = TrajectoryErrorUnder(Sim3(), truth, estimate);
  ASSERT_TRUE(error.ok()) << error.status();
  EXPECT_NEAR(error->mean_m, 0.175, kTolerance_m);
  EXPECT_NEAR(error->rmse_m, std::sqrt(0.21 / 4), kTolerance_m);
  EXPECT_NEAR(error->median_m, 0.15, kTolerance_m);
  EXPECT_NEAR(error->max_m, 0.4, kTolerance_m);
}

TEST(TrajectoryErrorTest, GrowsWithTheNoiseOfThePoses) {
  // Noise of sigma an axis leaves sigma * sqrt(3) of error, less the 6 degrees of freedom that the alignment takes.
  const auto truth = Curve(2000);
  for (const double sigma_m : {0.01, 0.05, 0.2}) {
    Rng rng(11);
    const auto error = AbsoluteTrajectoryError(truth, Moved(SomePose(), 1.0, Shaken(truth, sigma_m, rng)), false);
    ASSERT_TRUE(error.ok()) << error.status();
    EXPECT_NEAR(error->rmse_m, sigma_m * std::sqrt(3.0), 0.05 * sigma_m);
  }
}

TEST(ScaleErrorTest, IsTheShareByWhichLengthsAreOff) {
  const auto truth = Curve(60);
  for (const double scale : {0.5, 0.98, 1.0, 1.03, 2.0}) {
    const auto error = ScaleError(truth, Moved(SomePose(), scale, truth));
    ASSERT_TRUE(error.ok()) << error.status();
    EXPECT_NEAR(*error, scale - 1, kTolerance_m);
  }
}

TEST(ScaleErrorTest, NoiseAloneIsNoScaleError) {
  const auto truth = Curve(2000);
  Rng rng(5);
  const auto error = ScaleError(truth, Shaken(truth, 0.02, rng));
  ASSERT_TRUE(error.ok()) << error.status();
  EXPECT_NEAR(*error, 0, 0.001);
}

TEST(ScaleErrorTest, ADeviceThatStoodStillHasNone) {
  EXPECT_EQ(ScaleError(Curve(20), Straight(20, 0)).status().code(), absl::StatusCode::kInvalidArgument);
  EXPECT_EQ(ScaleError(Straight(20, 0), Curve(20)).status().code(), absl::StatusCode::kInvalidArgument);
}

TEST(TrajectoryErrorTest, AlignmentIsTheLeastSquaresOne) {
  const auto truth = Curve(50);
  Rng rng(7);
  const auto estimate = Shaken(truth, 0.05, rng);
  const auto best = AbsoluteTrajectoryError(truth, estimate, false);
  ASSERT_TRUE(best.ok()) << best.status();
  for (int trial = 0; trial < 50; ++trial) {
    Eigen::Matrix<double, 6, 1> tangent;
    for (double& value : tangent) value = rng.Uniform(-0.02, 0.02);
    Sim3 other = best->T_truth_estimate;
    other.pose = other.pose * Pose3::Exp(tangent);
    EXPECT_GE(TrajectoryErrorUnder(other, truth, estimate)->rmse_m, best->rmse_m) << "trial " << trial;
  }
}

TEST(TrajectoryErrorTest, PairsTheNearestTimeWithinTheBound) {
  const auto truth = Curve(5);
  auto estimate = truth;
  estimate[1].stamp_ns += 19'000'000;
  estimate[2].stamp_ns -= 20'000'000;
  estimate[3].stamp_ns += 21'000'000;  // too late
  estimate[4].stamp_ns += 60'000'000;  // beyond the end
  const auto error = TrajectoryErrorUnder(Sim3(), truth, estimate, 0.02);
  ASSERT_TRUE(error.ok()) << error.status();
  EXPECT_EQ(error->num_paired, 3);
  EXPECT_NEAR(error->rmse_m, 0, kTolerance_m);
}

TEST(TrajectoryErrorTest, TruthNeedsNoOrder) {
  auto truth = Curve(20);
  const auto estimate = truth;
  std::reverse(truth.begin(), truth.end());
  const auto error = TrajectoryErrorUnder(Sim3(), truth, estimate);
  ASSERT_TRUE(error.ok()) << error.status();
  EXPECT_EQ(error->num_paired, 20);
  EXPECT_NEAR(error->max_m, 0, kTolerance_m);
}

TEST(TrajectoryErrorTest, FewerThanThreePairsAreNotEnough) {
  const auto truth = Curve(10);
  for (const auto& estimate : {std::vector<StampedPose>{}, Curve(2)}) {
    const Status status = AbsoluteTrajectoryError(truth, estimate, false).status();
    EXPECT_EQ(status.code(), absl::StatusCode::kInvalidArgument);
    EXPECT_THAT(std::string(status.message()), testing::HasSubstr("at least 3"));
  }
  EXPECT_EQ(AbsoluteTrajectoryError({}, truth, false).status().code(), absl::StatusCode::kInvalidArgument);
}

}  // namespace
}  // namespace mapp
