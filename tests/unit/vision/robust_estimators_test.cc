#include "vision/robust_estimators.h"

#include "tests/unit/vision/synthetic.h"

#include <gtest/gtest.h>

#include <algorithm>

namespace mapp {
namespace {

using test::kCamera;

struct PairScene {
  Sim3 T_target_source;
  std::vector<Eigen::Vector3d> source, target;
  std::vector<double> tolerances_m;
  std::vector<bool> is_outlier;
};

PairScene MakePairs(int count, double outlier_share, double scale, uint64_t seed) {
  Rng rng(seed);
  PairScene scene;
  scene.T_target_source = {scale, test::RandomPose(3.0, 10.0, rng)};
  for (int i = 0; i < count; ++i) {
    scene.source.push_back(test::RandomVector(3.0, rng));
    const bool is_outlier = rng.Uniform() < outlier_share;
    const Eigen::Vector3d noise = test::RandomVector(0.01, rng);
    scene.target.push_back(scene.T_target_source * scene.source.back() + noise);
    if (is_outlier) scene.target.back() = scene.T_target_source * test::RandomVector(3.0, rng);
    scene.tolerances_m.push_back(0.05);
    scene.is_outlier.push_back(is_outlier);
  }
  return scene;
}

class EstimateRigidTest : public ::testing::TestWithParam<bool> {};
INSTANTIATE_TEST_SUITE_P(RigidAndSimilarity, EstimateRigidTest, ::testing::Bool(),
                         [](const auto& case_info) { return case_info.param ? "Similarity" : "Rigid"; });

TEST_P(EstimateRigidTest, FindsTheMotionAmongOutliers) {
  const double scale = GetParam() ? 2.5 : 1.0;
  for (uint64_t seed = 1; seed <= 10; ++seed) {
    const PairScene scene = MakePairs(120, 0.6, scale, seed);
    const auto result = EstimateRigid(scene.source, scene.target, scene.tolerances_m, GetParam(), {});
    ASSERT_TRUE(result.has_value()) << "seed " << seed;
    EXPECT_NEAR(result->T_target_source.scale, scale, 0.005 * scale);
    EXPECT_LT(RotationAngle(result->T_target_source.pose, scene.T_target_source.pose), 0.01);
    EXPECT_LT(Distance(result->T_target_source.pose, scene.T_target_source.pose), 0.05);
    for (size_t i = 0; i < scene.source.size(); ++i) {
      EXPECT_TRUE(scene.is_outlier[i] || result->inliers[i]) << "seed " << seed << " pair " << i;
    }
    EXPECT_EQ(result->num_inliers, std::count(result->inliers.begin(), result->inliers.end(), true));
  }
}

TEST_P(EstimateRigidTest, TheSameSeedGivesTheSameResult) {
  const PairScene scene = MakePairs(80, 0.7, 1.0, 3);
  const auto first = EstimateRigid(scene.source, scene.target, scene.tolerances_m, GetParam(), {.seed = 9});
  const auto second = EstimateRigid(scene.source, scene.target, scene.tolerances_m, GetParam(), {.seed = 9});
  ASSERT_TRUE(first.has_value());
  ASSERT_TRUE(second.has_value());
  EXPECT_EQ(first->inliers, second->inliers);
  EXPECT_EQ(first->T_target_source.pose.translation(), second->T_target_source.pose.translation());
  EXPECT_EQ(first->T_target_source.scale, second->T_target_source.scale);
}

TEST_P(EstimateRigidTest, FindsNoConsensusInNoise) {
  PairScene scene = MakePairs(100, 0.0, 1.0, 5);
  Rng rng(6);
  for (Eigen::Vector3d& point : scene.target) point = test::RandomVector(3.0, rng);
  EXPECT_FALSE(EstimateRigid(scene.source, scene.target, scene.tolerances_m, GetParam(), {}).has_value());
}

TEST_P(EstimateRigidTest, RefusesPointsOnALine) {
  std::vector<Eigen::Vector3d> line;
  for (int i = 0; i < 50; ++i) line.push_back(Eigen::Vector3d(1, 2, 3) * (0.1 * i));
  const std::vector<double> tolerances(line.size(), 0.05);
  EXPECT_FALSE(EstimateRigid(line, line, tolerances, GetParam(), {}).has_value());
}

TEST_P(EstimateRigidTest, RefusesTooFewOrUnequalInputs) {
  const PairScene scene = MakePairs(14, 0.0, 1.0, 7);
  const RansacOptions options;
  ASSERT_GT(options.min_inliers, 14);
  EXPECT_FALSE(EstimateRigid(scene.source, scene.target, scene.tolerances_m, GetParam(), options).has_value());
  EXPECT_FALSE(EstimateRigid({}, {}, {}, GetParam(), {.min_inliers = 0}).has_value());
  const std::span<const Eigen::Vector3d> shorter = std::span(scene.target).first(10);
  EXPECT_FALSE(EstimateRigid(scene.source, shorter, scene.tolerances_m, GetParam(), {.min_inliers = 3}).has_value());
}

struct PixelScene {
  Pose3 T_world_camera;
  std::vector<Eigen::Vector3d> p_world;
  std::vector<Eigen::Vector2d> pixels;
  std::vector<bool> is_outlier;
};

PixelScene MakePixels(int count, double outlier_share, uint64_t seed) {
  Rng rng(seed);
  PixelScene scene;
  scene.T_world_camera = test::RandomPose(3.0, 10.0, rng);
  for (int i = 0; i < count; ++i) {
    const Eigen::Vector3d p_camera = test::RandomVisiblePoint(rng);
    scene.p_world.push_back(scene.T_world_camera * p_camera);
    const bool is_outlier = rng.Uniform() < outlier_share;
    const Eigen::Vector2d noise(0.5 * rng.Normal(), 0.5 * rng.Normal());
    const Eigen::Vector2d anywhere(rng.Uniform(0, 640), rng.Uniform(0, 480));
    scene.pixels.push_back(is_outlier ? anywhere : Eigen::Vector2d(kCamera.Project(p_camera) + noise));
    scene.is_outlier.push_back(is_outlier);
  }
  return scene;
}

TEST(EstimatePoseTest, FindsThePoseAmongOutliers) {
  for (uint64_t seed = 1; seed <= 10; ++seed) {
    const PixelScene scene = MakePixels(150, 0.6, seed);
    const auto result = EstimatePose(kCamera, scene.p_world, scene.pixels, 3.0, {});
    ASSERT_TRUE(result.has_value()) << "seed " << seed;
    EXPECT_LT(Distance(result->T_world_camera, scene.T_world_camera), 0.03) << "seed " << seed;
    EXPECT_LT(RotationAngle(result->T_world_camera, scene.T_world_camera), 0.01) << "seed " << seed;
    const auto num_good = std::count(scene.is_outlier.begin(), scene.is_outlier.end(), false);
    EXPECT_GE(result->num_inliers, num_good - 1) << "seed " << seed;
  }
}

TEST(EstimatePoseTest, TheSameSeedGivesTheSameResult) {
  const PixelScene scene = MakePixels(100, 0.6, 11);
  const auto first = EstimatePose(kCamera, scene.p_world, scene.pixels, 3.0, {.seed = 5});
  const auto second = EstimatePose(kCamera, scene.p_world, scene.pixels, 3.0, {.seed = 5});
  ASSERT_TRUE(first.has_value());
  ASSERT_TRUE(second.has_value());
  EXPECT_EQ(first->T_world_camera.translation(), second->T_world_camera.translation());
  EXPECT_EQ(first->inliers, second->inliers);
}

TEST(EstimatePoseTest, FindsNoConsensusInNoise) {
  const PixelScene scene = MakePixels(100, 1.0, 12);
  EXPECT_FALSE(EstimatePose(kCamera, scene.p_world, scene.pixels, 3.0, {}).has_value());
}

TEST(EstimatePoseTest, SurvivesDegeneratePoints) {
  const std::vector<Eigen::Vector3d> same(30, Eigen::Vector3d(1, 1, 3));
  const std::vector<Eigen::Vector2d> pixels(30, Eigen::Vector2d(100, 100));
  const auto result = EstimatePose(kCamera, same, pixels, 3.0, {});
  EXPECT_TRUE(!result.has_value() || result->T_world_camera.IsFinite());
  EXPECT_FALSE(EstimatePose(kCamera, {}, {}, 3.0, {}).has_value());
  EXPECT_FALSE(EstimatePose(kCamera, same, std::span(pixels).first(20), 3.0, {}).has_value());
}

}  // namespace
}  // namespace mapp
