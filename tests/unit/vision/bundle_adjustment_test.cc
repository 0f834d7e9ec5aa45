#include "vision/bundle_adjustment.h"

#include "tests/unit/vision/synthetic.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <limits>
#include <numbers>
#include <string>

namespace mapp {
namespace {

using test::kCamera;
using ::testing::StartsWith;

/// A camera moving sideways past a cloud; every camera sees most points.
BundleProblem TrueProblem(int num_frames, int num_points, bool with_depth, double noise_px) {
  Rng rng(51);
  BundleProblem problem;
  for (int i = 0; i < num_frames; ++i) {
    const Pose3 wobble = test::RandomPose(0.1, 0.02, rng);
    const Pose3 T_world_camera = Pose3(Eigen::Quaterniond::Identity(), {0.15 * i, 0, 0}) * wobble;
    problem.frames.push_back({.camera = kCamera, .T_world_camera = T_world_camera, .fixed = i < 2});
  }
  for (int i = 0; i < num_points; ++i) problem.points.push_back({.p_world = test::RandomVisiblePoint(rng)});
  for (int frame_idx = 0; frame_idx < num_frames; ++frame_idx) {
    const Pose3 T_camera_world = problem.frames[static_cast<size_t>(frame_idx)].T_world_camera.Inverse();
    for (int point_idx = 0; point_idx < num_points; ++point_idx) {
      const Eigen::Vector3d p_camera = T_camera_world * problem.points[static_cast<size_t>(point_idx)].p_world;
      const Eigen::Vector2d noise(noise_px * rng.Normal(), noise_px * rng.Normal());
      const Eigen::Vector2d pixel = kCamera.Project(p_camera) + noise;
      if (pixel.x() < 0 || pixel.x() > 640 || pixel.y() < 0 || pixel.y() > 480) continue;
      problem.observations.push_back(
          {.frame_idx = frame_idx, .point_idx = point_idx, .pixel = pixel, .depth_m = with_depth ? p_camera.z() : 0.0});
    }
  }
  return problem;
}

BundleProblem Disturbed(BundleProblem problem) {
  Rng rng(52);
  for (BundleProblem::Frame& frame : problem.frames) {
    if (!frame.fixed) frame.T_world_camera = frame.T_world_camera * test::RandomPose(0.02, 0.03, rng);
  }
  for (BundleProblem::Point& point : problem.points) {
    if (!point.fixed) point.p_world += test::RandomVector(0.05, rng);
  }
  return problem;
}

double MaxPoseError(const BundleProblem& a, const BundleProblem& b) {
  double error = 0;
  for (size_t i = 0; i < a.frames.size(); ++i) {
    error = std::max(error, Distance(a.frames[i].T_world_camera, b.frames[i].T_world_camera));
    error = std::max(error, RotationAngle(a.frames[i].T_world_camera, b.frames[i].T_world_camera));
  }
  return error;
}

class AdjustBundleTest : public ::testing::TestWithParam<bool> {};
INSTANTIATE_TEST_SUITE_P(MonoAndDepth, AdjustBundleTest, ::testing::Bool(),
                         [](const auto& case_info) { return case_info.param ? "Depth" : "Mono"; });

TEST_P(AdjustBundleTest, RecoversAPerfectWorld) {
  const BundleProblem truth = TrueProblem(6, 120, GetParam(), 0.0);
  BundleProblem problem = Disturbed(truth);
  const auto result = AdjustBundle(problem, {.max_iterations = 50});
  ASSERT_TRUE(result.ok()) << result.status();
  EXPECT_GT(result->initial_rmse_px, 5.0);
  EXPECT_LT(result->final_rmse_px, 1e-3);
  EXPECT_LT(result->final_cost, result->initial_cost);
  EXPECT_LT(MaxPoseError(problem, truth), 1e-4);
  EXPECT_THAT(result->outliers, ::testing::Each(false));
}

TEST_P(AdjustBundleTest, FlagsOutliersAndStandsThem) {
  const BundleProblem truth = TrueProblem(6, 120, GetParam(), 0.3);
  BundleProblem problem = Disturbed(truth);
  // Across the camera's motion: along it, a point seen twice could follow.
  for (size_t i = 0; i < problem.observations.size(); i += 20) problem.observations[i].pixel.y() += 40;
  const auto result = AdjustBundle(problem, {.max_iterations = 50});
  ASSERT_TRUE(result.ok()) << result.status();
  for (size_t i = 0; i < problem.observations.size(); i += 20) EXPECT_TRUE(result->outliers[i]) << i;
  EXPECT_LT(MaxPoseError(problem, truth), 0.02);
}

TEST_P(AdjustBundleTest, LeavesFixedFramesAndPointsAlone) {
  const BundleProblem truth = TrueProblem(5, 60, GetParam(), 0.5);
  BundleProblem problem = Disturbed(truth);
  for (size_t i = 0; i < 20; ++i) problem.points[i].fixed = true;
  const BundleProblem start = problem;
  ASSERT_TRUE(AdjustBundle(problem, {}).ok());
  for (size_t i = 0; i < 2; ++i) {
    EXPECT_EQ(problem.frames[i].T_world_camera.translation(), start.frames[i].T_world_camera.translation());
  }
  for (size_t i = 0; i < 20; ++i) EXPECT_EQ(problem.points[i].p_world, start.points[i].p_world);
  EXPECT_NE(problem.points[30].p_world, start.points[30].p_world);
}

/// 120 free frames take the sparse solver, or the iterative one where all frames see the same points.
TEST(AdjustBundleTest, LargeProblemsUseOtherSolvers) {
  for (const int num_frames : {122, 12}) {
    BundleProblem truth = TrueProblem(num_frames, 40, true, 0.0);
    if (num_frames == 12) {
      // All-to-all covisibility: the same views, ten times over.
      const BundleProblem once = truth;
      for (int copy = 1; copy < 11; ++copy) {
        for (const BundleProblem::Frame& frame : once.frames) {
          truth.frames.push_back(frame);
          truth.frames.back().fixed = false;
        }
        for (BundleProblem::Observation observation : once.observations) {
          observation.frame_idx += copy * 12;
          truth.observations.push_back(observation);
        }
      }
    }
    BundleProblem problem = Disturbed(truth);
    const auto result = AdjustBundle(problem, {.max_iterations = 30, .num_threads = 2});
    ASSERT_TRUE(result.ok()) << result.status();
    EXPECT_LT(result->final_rmse_px, 0.05);
  }
}

TEST(AdjustBundleTest, AdjustsPosesAloneWhenAllPointsAreFixed) {
  const BundleProblem truth = TrueProblem(4, 60, false, 0.0);
  BundleProblem problem = truth;
  for (BundleProblem::Point& point : problem.points) point.fixed = true;
  problem = Disturbed(problem);
  const auto result = AdjustBundle(problem, {.max_iterations = 30});
  ASSERT_TRUE(result.ok()) << result.status();
  EXPECT_LT(MaxPoseError(problem, truth), 1e-5);
}

TEST(AdjustBundleTest, PointsBehindTheCameraAreOutliersAndPullNothing) {
  const BundleProblem truth = TrueProblem(4, 60, false, 0.0);
  BundleProblem problem = truth;
  problem.points.push_back({.p_world = {0, 0, -3}, .fixed = true});
  problem.observations.push_back({.frame_idx = 3, .point_idx = 60, .pixel = {100, 100}});
  const auto result = AdjustBundle(problem, {});
  ASSERT_TRUE(result.ok()) << result.status();
  EXPECT_TRUE(result->outliers.back());
  EXPECT_LT(MaxPoseError(problem, truth), 1e-6);
}

TEST(AdjustBundleTest, ReportsIterationsAndStopsWhenCancelled) {
  BundleProblem problem = Disturbed(TrueProblem(6, 100, false, 0.5));
  std::vector<int> iterations;
  BundleOptions options;
  options.max_iterations = 50;
  options.on_iteration = [&](int iteration, double cost) {
    iterations.push_back(iteration);
    EXPECT_GT(cost, 0);
  };
  options.is_cancelled = [&] { return iterations.size() >= 2; };
  const auto result = AdjustBundle(problem, options);
  ASSERT_TRUE(result.ok()) << result.status();
  EXPECT_TRUE(result->cancelled);
  EXPECT_THAT(iterations, ::testing::ElementsAre(1, 2));
  EXPECT_EQ(result->num_iterations, 2);
  EXPECT_LT(result->final_cost, result->initial_cost) << "the best state so far is kept";
  EXPECT_LT(result->final_rmse_px, result->initial_rmse_px);
}

TEST(AdjustBundleTest, CancelledAtOnceChangesNothing) {
  BundleProblem problem = Disturbed(TrueProblem(4, 50, false, 0.5));
  const BundleProblem start = problem;
  BundleOptions options;
  options.is_cancelled = [] { return true; };
  const auto result = AdjustBundle(problem, options);
  ASSERT_TRUE(result.ok()) << result.status();
  EXPECT_TRUE(result->cancelled);
  EXPECT_LT(MaxPoseError(problem, start), 1e-12);
}

/// Cameras on a quarter circle, each linked to the next by what the truth says; the estimates are off.
BundleProblem Chain(int num_frames, Rng& rng) {
  BundleProblem problem;
  for (int i = 0; i < num_frames; ++i) {
    const double heading = 0.5 * std::numbers::pi * i / num_frames;
    const Pose3 truth(ExpSo3({0, heading, 0}), {5 * std::sin(heading), 0, -5 * std::cos(heading)});
    problem.frames.push_back({.camera = kCamera, .T_world_camera = truth, .fixed = i == 0});
  }
  for (int i = 1; i < num_frames; ++i) {
    const Pose3 T_from_to = problem.frames[i - 1].T_world_camera.Inverse() * problem.frames[i].T_world_camera;
    problem.relative_poses.push_back({i - 1, i, T_from_to, 0.01, 0.005});
  }
  for (int i = 1; i < num_frames; ++i) {
    problem.frames[i].T_world_camera = problem.frames[i].T_world_camera * test::RandomPose(0.3, 0.2, rng);
  }
  return problem;
}

TEST(AdjustBundleTest, AGraphOfPosesFollowsItsLinks) {
  Rng rng(7);
  BundleProblem problem = Chain(30, rng);
  BundleOptions options;
  options.max_iterations = 50;
  ASSERT_TRUE(AdjustBundle(problem, options).ok());
  for (const BundleProblem::RelativePose& link : problem.relative_poses) {
    const Pose3 T_from_to =
        problem.frames[link.from_idx].T_world_camera.Inverse() * problem.frames[link.to_idx].T_world_camera;
    EXPECT_LT(Distance(T_from_to, link.T_from_to), 1e-5);
    EXPECT_LT(RotationAngle(T_from_to, link.T_from_to), 1e-5);
  }
}

TEST(AdjustBundleTest, AClosedLoopSharesItsErrorAmongTheLinks) {
  BundleProblem problem;
  constexpr int kFrames = 11;
  // Odometry tells a step of 1.01 m each; the last camera is known to stand at 10 m.
  for (int i = 0; i < kFrames; ++i) {
    const Pose3 told(Eigen::Quaterniond::Identity(), {1.01 * i, 0, 0});
    problem.frames.push_back({.camera = kCamera, .T_world_camera = told, .fixed = i == 0 || i == kFrames - 1});
    if (i > 0) {
      problem.relative_poses.push_back({i - 1, i, Pose3(Eigen::Quaterniond::Identity(), {1.01, 0, 0}), 0.02, 0.005});
    }
  }
  problem.frames.back().T_world_camera = Pose3(Eigen::Quaterniond::Identity(), {10, 0, 0});
  ASSERT_TRUE(AdjustBundle(problem, {}).ok());
  for (int i = 0; i < kFrames; ++i) {
    EXPECT_NEAR(problem.frames[i].T_world_camera.translation().x(), 1.0 * i, 1e-4) << i;
  }
}

TEST(AdjustBundleTest, ALinkHoldsACameraThatHardlySharesPoints) {
  BundleProblem problem = TrueProblem(6, 80, /*with_depth=*/false, 0.5);
  // The last one keeps three observations, each a false match.
  int num_kept = 0;
  std::erase_if(problem.observations, [&](BundleProblem::Observation& observation) {
    if (observation.frame_idx != 5) return false;
    observation.pixel += Eigen::Vector2d(4, -3);
    return ++num_kept > 3;
  });
  const Pose3 truth = problem.frames[5].T_world_camera;
  BundleProblem loose = problem;
  ASSERT_TRUE(AdjustBundle(loose, {}).ok());
  problem.relative_poses.push_back(
      {4, 5, problem.frames[4].T_world_camera.Inverse() * truth, /*sigma_m=*/0.002, /*sigma_rad=*/0.001});
  ASSERT_TRUE(AdjustBundle(problem, {}).ok());
  EXPECT_GT(Distance(loose.frames[5].T_world_camera, truth), 0.02) << "else the case shows nothing";
  EXPECT_LT(Distance(problem.frames[5].T_world_camera, truth), 0.01);
}

TEST(AdjustBundleTest, AcceptsAProblemWithoutObservations) {
  BundleProblem problem;
  problem.frames.push_back({.camera = kCamera, .T_world_camera = Pose3(), .fixed = true});
  const auto result = AdjustBundle(problem, {});
  ASSERT_TRUE(result.ok()) << result.status();
  EXPECT_EQ(result->num_iterations, 0);
}

struct BadProblem {
  std::string name;
  void (*spoil)(BundleProblem&);
  std::string field;
};

class AdjustBundleErrorTest : public ::testing::TestWithParam<BadProblem> {};

TEST_P(AdjustBundleErrorTest, NamesTheFieldAndTouchesNothing) {
  BundleProblem problem = Disturbed(TrueProblem(4, 30, false, 0.0));
  GetParam().spoil(problem);
  const BundleProblem start = problem;
  const auto result = AdjustBundle(problem, {});
  ASSERT_EQ(result.status().code(), absl::StatusCode::kInvalidArgument);
  EXPECT_THAT(std::string(result.status().message()), StartsWith(GetParam().field + ":"));
  EXPECT_EQ(problem.frames[3].T_world_camera.translation(), start.frames[3].T_world_camera.translation());
}

INSTANTIATE_TEST_SUITE_P(
    All, AdjustBundleErrorTest,
    ::testing::Values(
        BadProblem{"NoFixedFrame", [](BundleProblem& p) { p.frames[0].fixed = p.frames[1].fixed = false; }, "frames"},
        BadProblem{"FrameIndex", [](BundleProblem& p) { p.observations[5].frame_idx = 4; },
                   "observations[5].frame_idx"},
        BadProblem{"PointIndex", [](BundleProblem& p) { p.observations[6].point_idx = -1; },
                   "observations[6].point_idx"},
        BadProblem{"Sigma", [](BundleProblem& p) { p.observations[7].sigma_px = 0; }, "observations[7].sigma_px"},
        BadProblem{"LinkIndex",
                   [](BundleProblem& p) { p.relative_poses.push_back({.from_idx = 1, .to_idx = 4, .T_from_to = {}}); },
                   "relative_poses[0]"},
        BadProblem{"LinkToItself",
                   [](BundleProblem& p) { p.relative_poses.push_back({.from_idx = 2, .to_idx = 2, .T_from_to = {}}); },
                   "relative_poses[0]"},
        BadProblem{"LinkSigma",
                   [](BundleProblem& p) {
                     p.relative_poses.push_back({.from_idx = 1, .to_idx = 2, .T_from_to = {}, .sigma_m = 0});
                   },
                   "relative_poses[0]"},
        BadProblem{"Pixel",
                   [](BundleProblem& p) { p.observations[8].pixel.x() = std::numeric_limits<double>::quiet_NaN(); },
                   "observations[8].pixel"},
        BadProblem{"Point", [](BundleProblem& p) { p.points[2].p_world.z() = std::numeric_limits<double>::infinity(); },
                   "points[2].p_world"},
        BadProblem{"Focal", [](BundleProblem& p) { p.frames[1].camera.fx = 0; }, "frames[1].camera"}),
    [](const auto& case_info) { return case_info.param.name; });

}  // namespace
}  // namespace mapp
