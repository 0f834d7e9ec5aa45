#include "vision/pose_optimizer.h"

#include "tests/unit/vision/synthetic.h"

#include <Eigen/Eigenvalues>
#include <gtest/gtest.h>

#include <algorithm>
#include <limits>

namespace mapp {
namespace {

using test::kCamera;

struct Scene {
  Pose3 T_world_camera;
  std::vector<PoseObservation> observations;
  std::vector<bool> is_outlier;
};

Scene MakeScene(int count, double noise_px, double outlier_share, bool with_depth, uint64_t seed) {
  Rng rng(seed);
  Scene scene;
  scene.T_world_camera = test::RandomPose(3.0, 4.0, rng);
  for (int i = 0; i < count; ++i) {
    const Eigen::Vector3d p_camera = test::RandomVisiblePoint(rng);
    PoseObservation observation;
    observation.p_world = scene.T_world_camera * p_camera;
    observation.sigma_px = OctaveScale(static_cast<int>(rng.Below(kPyramidLevels)));
    const double sigma_px = noise_px * observation.sigma_px;
    const Eigen::Vector2d noise(sigma_px * rng.Normal(), sigma_px * rng.Normal());
    observation.pixel = kCamera.Project(p_camera) + noise;
    if (with_depth) observation.depth_m = 40.0 / (40.0 / p_camera.z() + sigma_px * rng.Normal());
    const bool is_outlier = rng.Uniform() < outlier_share;
    if (is_outlier) observation.pixel += Eigen::Vector2d(rng.Uniform(25, 80), rng.Uniform(-80, -25));
    scene.observations.push_back(observation);
    scene.is_outlier.push_back(is_outlier);
  }
  return scene;
}

Pose3 Disturbed(const Pose3& pose) {
  return pose * Pose3::Exp((Eigen::Matrix<double, 6, 1>() << 0.1, -0.08, 0.12, 0.05, -0.06, 0.04).finished());
}

class OptimizePoseTest : public ::testing::TestWithParam<bool> {};
INSTANTIATE_TEST_SUITE_P(MonoAndDepth, OptimizePoseTest, ::testing::Bool(),
                         [](const auto& case_info) { return case_info.param ? "Depth" : "Mono"; });

TEST_P(OptimizePoseTest, RecoversAPerfectPose) {
  const Scene scene = MakeScene(100, 0.0, 0.0, GetParam(), 31);
  const PoseResult result = OptimizePose(kCamera, scene.observations, Disturbed(scene.T_world_camera), {});
  EXPECT_TRUE(result.converged);
  EXPECT_EQ(result.num_inliers, 100);
  EXPECT_LT(Distance(result.T_world_camera, scene.T_world_camera), 1e-6);
  EXPECT_LT(RotationAngle(result.T_world_camera, scene.T_world_camera), 1e-6);
  EXPECT_LT(result.rmse_px, 1e-4);
}

TEST_P(OptimizePoseTest, SeparatesOutliers) {
  for (uint64_t seed = 1; seed <= 10; ++seed) {
    const Scene scene = MakeScene(300, 0.5, 0.35, GetParam(), seed);
    const PoseResult result = OptimizePose(kCamera, scene.observations, Disturbed(scene.T_world_camera), {});
    ASSERT_TRUE(result.converged) << "seed " << seed;
    EXPECT_LT(Distance(result.T_world_camera, scene.T_world_camera), 0.02) << "seed " << seed;
    EXPECT_LT(RotationAngle(result.T_world_camera, scene.T_world_camera), 0.005) << "seed " << seed;
    for (size_t i = 0; i < scene.is_outlier.size(); ++i) {
      EXPECT_FALSE(scene.is_outlier[i] && result.inliers[i]) << "seed " << seed << " observation " << i;
    }
    EXPECT_EQ(result.num_inliers, std::count(result.inliers.begin(), result.inliers.end(), true));
    const auto num_good = std::count(scene.is_outlier.begin(), scene.is_outlier.end(), false);
    // The noise is half of what the bound allows, so next to no good observation is lost.
    EXPECT_GE(result.num_inliers, 0.98 * static_cast<double>(num_good));
  }
}

/// The inverse of the information is the covariance: errors over many noisy scenes must match it.
TEST_P(OptimizePoseTest, InformationPredictsTheError) {
  constexpr int kScenes = 100;
  double sum = 0;
  for (uint64_t seed = 1; seed <= kScenes; ++seed) {
    const Scene scene = MakeScene(150, 1.0, 0.0, GetParam(), seed);
    // Without a bound none is rejected, which would shorten the tails.
    const PoseOptions options{.chi2_mono = 1e9, .chi2_depth = 1e9};
    const PoseResult result = OptimizePose(kCamera, scene.observations, scene.T_world_camera, options);
    const Eigen::Matrix<double, 6, 1> error = (scene.T_world_camera.Inverse() * result.T_world_camera).Log();
    sum += error.dot(result.information * error);
  }
  // Chi-square of 6 degrees of freedom: mean 6, standard deviation of the mean of 100 is 0.35.
  EXPECT_NEAR(sum / kScenes, 6.0, 1.4);
}

TEST(OptimizePoseTest, ReturnsTheStartForTooFewObservations) {
  const Scene scene = MakeScene(5, 0.0, 0.0, false, 41);
  const PoseResult result = OptimizePose(kCamera, scene.observations, scene.T_world_camera, {});
  EXPECT_FALSE(result.converged);
  EXPECT_EQ(result.num_inliers, 0);
  EXPECT_EQ(result.inliers.size(), 5U);
  EXPECT_LT(Distance(result.T_world_camera, scene.T_world_camera), 1e-12);
  EXPECT_FALSE(OptimizePose(kCamera, {}, scene.T_world_camera, {}).converged);
}

TEST(OptimizePoseTest, IgnoresObservationsThatAreNotNumbers) {
  Scene scene = MakeScene(60, 0.0, 0.0, true, 42);
  constexpr double kNan = std::numeric_limits<double>::quiet_NaN();
  scene.observations[3].pixel.x() = kNan;
  scene.observations[7].p_world.z() = kNan;
  scene.observations[11].depth_m = kNan;
  scene.observations[13].sigma_px = 0;
  const PoseResult result = OptimizePose(kCamera, scene.observations, Disturbed(scene.T_world_camera), {});
  EXPECT_TRUE(result.converged);
  EXPECT_EQ(result.num_inliers, 56);
  EXPECT_LT(Distance(result.T_world_camera, scene.T_world_camera), 1e-6);
}

TEST(OptimizePoseTest, PointsBehindTheCameraAreOutliers) {
  Scene scene = MakeScene(60, 0.0, 0.0, false, 43);
  for (size_t i = 0; i < 5; ++i) scene.observations[i].p_world = scene.T_world_camera * Eigen::Vector3d(0.1, 0.1, -2.0);
  const PoseResult result = OptimizePose(kCamera, scene.observations, Disturbed(scene.T_world_camera), {});
  EXPECT_TRUE(result.converged);
  EXPECT_EQ(result.num_inliers, 55);
  EXPECT_FALSE(result.inliers[0]);
}

TEST(OptimizePoseTest, SaysSoWhenNothingFits) {
  Scene scene = MakeScene(40, 0.0, 0.0, false, 44);
  Rng rng(45);
  for (PoseObservation& observation : scene.observations) {
    observation.pixel = {rng.Uniform(0, 640), rng.Uniform(0, 480)};
  }
  const PoseResult result = OptimizePose(kCamera, scene.observations, scene.T_world_camera, {});
  EXPECT_LT(result.num_inliers, 15);
  EXPECT_TRUE(result.T_world_camera.IsFinite());
}

TEST(OptimizePoseTest, InformationIsSymmetricAndPositive) {
  const Scene scene = MakeScene(50, 0.5, 0.0, true, 46);
  const PoseResult result = OptimizePose(kCamera, scene.observations, scene.T_world_camera, {});
  EXPECT_LT((result.information - result.information.transpose()).norm(), 1e-6 * result.information.norm());
  const Eigen::SelfAdjointEigenSolver<Eigen::Matrix<double, 6, 6>> solver(result.information);
  EXPECT_GT(solver.eigenvalues().minCoeff(), 0.0);
}

}  // namespace
}  // namespace mapp
