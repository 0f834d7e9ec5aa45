#include "vision/two_view.h"

#include "tests/unit/vision/synthetic.h"

#include <gtest/gtest.h>

#include <cmath>
#include <functional>
#include <string>

namespace mapp {
namespace {

using test::kCamera;

constexpr double kNoisePx = 0.5;
constexpr uint64_t kNumSeeds = 10;
/// What half a pixel of noise leaves with 300 matches and a tenth of the depth between the cameras.
constexpr double kMaxRotationError = 0.02;
constexpr double kMaxDirectionError = 0.15;

struct Views {
  Pose3 T_first_second;
  std::vector<TwoViewMatch> matches;
  std::vector<Eigen::Vector3d> points_first;
};

/// A point on the ray through a pixel of the first image.
using Surface = std::function<Eigen::Vector3d(const Eigen::Vector3d& ray, Rng& rng)>;

Eigen::Vector3d AnyDepth(const Eigen::Vector3d& ray, Rng& rng) { return rng.Uniform(2, 8) * ray; }

/// A wall, turned by 40 degrees against the view.
Eigen::Vector3d OnWall(const Eigen::Vector3d& ray, Rng&) {
  const Eigen::Vector3d normal(std::sin(0.7), 0, std::cos(0.7));
  return 4 / normal.dot(ray) * ray;
}

/// The same with a fifth of the points before it.
Eigen::Vector3d WallWithThings(const Eigen::Vector3d& ray, Rng& rng) {
  const Eigen::Vector3d on_wall = OnWall(ray, rng);
  return rng.Uniform() < 0.2 ? Eigen::Vector3d(rng.Uniform(0.5, 0.9) * on_wall) : on_wall;
}

Eigen::Vector2d WithNoise(const Eigen::Vector2d& pixel, Rng& rng) {
  // Uniform noise of the same deviation.
  const double half_range = kNoisePx * std::sqrt(3.0);
  return pixel + Eigen::Vector2d(rng.Uniform(-half_range, half_range), rng.Uniform(-half_range, half_range));
}

Views MakeViews(const Surface& surface, const Pose3& T_first_second, double outlier_share, uint64_t seed) {
  Rng rng(seed);
  Views views;
  views.T_first_second = T_first_second;
  const auto random_pixel = [&] {
    return Eigen::Vector2d(rng.Uniform(5, test::kWidth_px - 5), rng.Uniform(5, test::kHeight_px - 5));
  };
  while (views.matches.size() < 300) {
    const Eigen::Vector2d pixel = random_pixel();
    const Eigen::Vector3d point = surface(kCamera.Unproject(pixel), rng);
    const Eigen::Vector3d p_second = T_first_second.Inverse() * point;
    if (p_second.z() <= 0.1) continue;
    TwoViewMatch match{WithNoise(pixel, rng), WithNoise(kCamera.Project(p_second), rng), 1.0};
    if (rng.Uniform() < outlier_share) match.second = random_pixel();
    views.matches.push_back(match);
    views.points_first.push_back(point);
  }
  return views;
}

double DirectionError(const Pose3& found, const Pose3& expected) {
  return std::acos(std::clamp(found.translation().normalized().dot(expected.translation().normalized()), -1.0, 1.0));
}

void ExpectTrue(const TwoViewGeometry& geometry, const Views& views) {
  EXPECT_LT(RotationAngle(geometry.T_first_second, views.T_first_second), kMaxRotationError);
  EXPECT_LT(DirectionError(geometry.T_first_second, views.T_first_second), kMaxDirectionError);
  EXPECT_NEAR(geometry.T_first_second.translation().norm(), 1, 1e-9);
}

Pose3 Sideways() { return Pose3(ExpSo3({0.02, -0.06, 0.03}), {0.5, 0.05, 0.1}); }
Pose3 Forwards() { return Pose3(ExpSo3({0.01, 0.02, -0.02}), {0.05, -0.1, 0.7}); }

struct TwoViewCase {
  std::string name;
  Surface surface;
  Pose3 T_first_second;
};

class TwoViewTest : public ::testing::TestWithParam<TwoViewCase> {};
INSTANTIATE_TEST_SUITE_P(Scenes, TwoViewTest,
                         ::testing::Values(TwoViewCase{"GeneralSideways", AnyDepth, Sideways()},
                                           TwoViewCase{"GeneralForwards", AnyDepth, Forwards()},
                                           TwoViewCase{"PlaneSideways", OnWall, Sideways()},
                                           TwoViewCase{"PlaneWithThingsSideways", WallWithThings, Sideways()},
                                           TwoViewCase{"PlaneWithThingsForwards", WallWithThings, Forwards()}),
                         [](const auto& case_info) { return case_info.param.name; });

TEST_P(TwoViewTest, FindsMotionAndStructureAmongOutliers) {
  for (uint64_t seed = 1; seed <= kNumSeeds; ++seed) {
    SCOPED_TRACE(seed);
    const Views views = MakeViews(GetParam().surface, GetParam().T_first_second, 0.2, seed);
    const auto geometry = EstimateTwoViewGeometry(kCamera, views.matches, {});
    ASSERT_TRUE(geometry.has_value());
    ExpectTrue(*geometry, views);
    // Depths to within what the error of the motion makes of them, in units of the distance between the cameras.
    const double unit_m = views.T_first_second.translation().norm();
    int num_points = 0, num_right = 0;
    for (size_t i = 0; i < views.matches.size(); ++i) {
      if (!geometry->points_first[i]) continue;
      ++num_points;
      const double expected = views.points_first[i].z() / unit_m;
      if (std::abs(geometry->points_first[i]->z() - expected) < 0.25 * expected) ++num_right;
    }
    EXPECT_EQ(num_points, geometry->num_points);
    EXPECT_GE(num_points, 100);
    EXPECT_GE(num_right, 0.9 * num_points);
  }
}

TEST_P(TwoViewTest, TheSameInputGivesTheSameResult) {
  const Views views = MakeViews(GetParam().surface, GetParam().T_first_second, 0.3, 5);
  const auto first = EstimateTwoViewGeometry(kCamera, views.matches, {});
  const auto second = EstimateTwoViewGeometry(kCamera, views.matches, {});
  ASSERT_TRUE(first && second);
  EXPECT_EQ(first->T_first_second.Matrix(), second->T_first_second.Matrix());
}

// Two motions explain a bare plane approached head-on; a wrong one must not be believed.
TEST(TwoViewPlaneTest, ApproachingABarePlaneIsRefusedOrRight) {
  for (uint64_t seed = 1; seed <= kNumSeeds; ++seed) {
    SCOPED_TRACE(seed);
    const Views views = MakeViews(OnWall, Forwards(), 0.1, seed);
    const auto geometry = EstimateTwoViewGeometry(kCamera, views.matches, {});
    if (geometry) ExpectTrue(*geometry, views);
  }
}

struct NoMotion {
  std::string name;
  Pose3 T_first_second;
};
class TwoViewRefusalTest : public ::testing::TestWithParam<NoMotion> {};
INSTANTIATE_TEST_SUITE_P(
    Motions, TwoViewRefusalTest,
    ::testing::Values(NoMotion{"None", Pose3()}, NoMotion{"SmallRotation", Pose3(ExpSo3({0.01, 0.03, 0}), {0, 0, 0})},
                      NoMotion{"LargeRotation", Pose3(ExpSo3({0.05, 0.35, 0.1}), {0, 0, 0})},
                      NoMotion{"RotationOfATripod", Pose3(ExpSo3({0, 0.2, 0}), {0.005, 0, 0.005})}),
    [](const auto& case_info) { return case_info.param.name; });

TEST_P(TwoViewRefusalTest, WithoutParallaxThereIsNoMap) {
  for (uint64_t seed = 1; seed <= 3; ++seed) {
    SCOPED_TRACE(seed);
    for (const Surface& surface : {Surface(AnyDepth), Surface(OnWall), Surface(WallWithThings)}) {
      for (const double outlier_share : {0.0, 0.2, 0.4}) {
        const Views views = MakeViews(surface, GetParam().T_first_second, outlier_share, seed);
        EXPECT_FALSE(EstimateTwoViewGeometry(kCamera, views.matches, {}).has_value()) << outlier_share;
      }
      const Views clean = MakeViews(surface, GetParam().T_first_second, 0, seed);
      EXPECT_GT(RotationShare(kCamera, clean.matches), 0.95);
    }
  }
}

TEST(TwoViewMatchesTest, MatchesThatHaveNothingInCommonMakeNoMap) {
  for (uint64_t seed = 1; seed <= 3; ++seed) {
    const Views views = MakeViews(AnyDepth, Sideways(), 1.0, seed);
    EXPECT_FALSE(EstimateTwoViewGeometry(kCamera, views.matches, {}).has_value()) << "seed " << seed;
  }
}

TEST(TwoViewMatchesTest, TooFewOrDegenerateMatchesMakeNoMap) {
  EXPECT_FALSE(EstimateTwoViewGeometry(kCamera, {}, {}).has_value());
  const std::vector<TwoViewMatch> in_one_place(200, TwoViewMatch{{100, 100}, {150, 100}, 1.0});
  EXPECT_FALSE(EstimateTwoViewGeometry(kCamera, in_one_place, {}).has_value());
  std::vector<TwoViewMatch> on_a_line;
  for (int i = 0; i < 200; ++i) on_a_line.push_back({{100.0 + i, 100}, {100 + 1.2 * i, 110}, 1.0});
  EXPECT_FALSE(EstimateTwoViewGeometry(kCamera, on_a_line, {}).has_value());
}

TEST(IntersectRaysTest, MeetsInTheMiddleAndRefusesParallels) {
  const Eigen::Vector3d origin_b(1, 0, 0);
  const auto point =
      IntersectRays({0, 0.1, 0}, Eigen::Vector3d(1, 0, 1).normalized(), origin_b, Eigen::Vector3d(0, 0, 1), 0.999);
  ASSERT_TRUE(point.has_value());
  EXPECT_LT((*point - Eigen::Vector3d(1, 0.05, 1)).norm(), 1e-9);
  EXPECT_FALSE(IntersectRays({0, 0, 0}, {0, 0, 1}, origin_b, {0, 0, 1}, 0.999).has_value());
}

}  // namespace
}  // namespace mapp
