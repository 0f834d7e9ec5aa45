#include "sim/scene_rays.h"

#include "tests/unit/sim/scenes.h"

#include <Eigen/Geometry>
#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <limits>
#include <thread>

namespace mapp::sim {
namespace {

/// 2 m x 2 m around the world's z axis; its front looks towards negative z.
Quad Wall(double z_m) { return PlainQuad({-1, -1, z_m}, {2, 0, 0}, {0, 2, 0}); }

SceneRays RaysOf(std::vector<Quad> quads) { return SceneRays(std::make_shared<const Scene>(Scene{std::move(quads)})); }

std::vector<Quad> RandomQuads(Rng& rng, int count, double half_m) {
  std::vector<Quad> quads;
  for (int i = 0; i < count; ++i) {
    const Eigen::Vector3d u = RandomPoint(rng, 1);
    const Eigen::Vector3d v = u.cross(RandomPoint(rng, 1)).normalized() * rng.Uniform(0.1, 2);
    quads.push_back(PlainQuad(RandomPoint(rng, half_m), u, v));
  }
  return quads;
}

TEST(SceneRaysTest, AWallHidesWhatIsBehindIt) {
  const SceneRays rays = RaysOf({Wall(2)});
  EXPECT_TRUE(rays.Occluded({0, 0, 0}, {0, 0, 3}, 0.01));
  EXPECT_FALSE(rays.Occluded({0, 0, 0}, {0, 0, 1.9}, 0.01)) << "before the wall";
  EXPECT_FALSE(rays.Occluded({0, 0, 0}, {1.6, 0, 3}, 0.01)) << "past the wall's edge: 1.07 m at z = 2";
  EXPECT_TRUE(rays.Occluded({0, 0, 0}, {1.4, 0, 3}, 0.01)) << "0.93 m at z = 2";
}

TEST(SceneRaysTest, APointOnASurfaceIsNotHiddenByItAndTheMarginIsMeasuredAlongTheRay) {
  const SceneRays rays = RaysOf({Wall(2)});
  EXPECT_FALSE(rays.Occluded({0, 0, 0}, {0.5, 0.5, 2}, 0.01));
  EXPECT_FALSE(rays.Occluded({0, 0, 0}, {0, 0, 2.009}, 0.01));
  EXPECT_TRUE(rays.Occluded({0, 0, 0}, {0, 0, 2.011}, 0.01));
  EXPECT_FALSE(rays.Occluded({0, 0, 0}, {0, 0, 3}, 5)) << "a margin longer than the ray";
}

TEST(SceneRaysTest, BacksHideNothing) {
  const SceneRays rays = RaysOf({Wall(2)});
  EXPECT_FALSE(rays.Occluded({0, 0, 3}, {0, 0, 0}, 0.01));
  // The ray goes on behind a back: the second wall, turned round, hides.
  const SceneRays two = RaysOf({Wall(2), PlainQuad({1, -1, 1}, {-2, 0, 0}, {0, 2, 0})});
  EXPECT_TRUE(two.Occluded({0, 0, 3}, {0, 0, 0}, 0.01));
}

TEST(SceneRaysTest, ManyPointsAreAnsweredAsEachAlone) {
  Rng rng(4);
  const SceneRays rays = RaysOf(RandomQuads(rng, 3000, 30));
  std::vector<Eigen::Vector3d> points;
  for (int i = 0; i < 500; ++i) points.push_back(RandomPoint(rng, 30));
  const auto occluded = rays.Occluded({1, 2, 3}, points, 0.05);
  const auto distances_m = rays.DistanceToSurface(points);
  ASSERT_EQ(occluded.size(), points.size());
  ASSERT_EQ(distances_m.size(), points.size());
  for (size_t i = 0; i < points.size(); ++i) {
    EXPECT_EQ(occluded[i] != 0, rays.Occluded({1, 2, 3}, points[i], 0.05));
    EXPECT_EQ(distances_m[i], rays.DistanceToSurface(points[i]));
  }
  const auto num_occluded = std::ranges::count(occluded, 1);
  EXPECT_GT(num_occluded, 20);
  EXPECT_LT(num_occluded, 480);
}

TEST(SceneRaysTest, DistanceIsMeasuredToFacesEdgesAndCornersFromBothSides) {
  const SceneRays rays = RaysOf({Wall(2)});
  EXPECT_NEAR(rays.DistanceToSurface({0.3, -0.4, 0.5}), 1.5, 1e-12);
  EXPECT_NEAR(rays.DistanceToSurface({0.3, -0.4, 3.5}), 1.5, 1e-12);
  EXPECT_NEAR(rays.DistanceToSurface({0.3, -0.4, 2}), 0, 1e-12);
  EXPECT_NEAR(rays.DistanceToSurface({4, 0, 6}), 5, 1e-12) << "3 m beyond the edge, 4 m off the plane";
  EXPECT_NEAR(rays.DistanceToSurface({2, 3, 4}), 3, 1e-12) << "(1, 2, 2) from the corner";
}

TEST(SceneRaysTest, DistanceAgreesWithTryingAllSurfaces) {
  Rng rng(9);
  const std::vector<Quad> quads = RandomQuads(rng, 1000, 80);
  const SceneRays all = RaysOf(quads);
  for (int i = 0; i < 50; ++i) {
    const Eigen::Vector3d p_world = RandomPoint(rng, 90);
    double nearest_m = std::numeric_limits<double>::infinity();
    for (const Quad& quad : quads) {
      // The nearest of a grid of points on the rectangle: an upper bound that is off by at most half a grid step.
      for (int u = 0; u <= 8; ++u) {
        for (int v = 0; v <= 8; ++v) {
          const Eigen::Vector3d on_quad = quad.corner_world + quad.edge_u_world * u / 8 + quad.edge_v_world * v / 8;
          nearest_m = std::min(nearest_m, (on_quad - p_world).norm());
        }
      }
    }
    EXPECT_LE(all.DistanceToSurface(p_world), nearest_m + 1e-12);
    EXPECT_GT(all.DistanceToSurface(p_world), nearest_m - 0.15);
  }
}

TEST(SceneRaysTest, AnEmptySceneHidesNothingAndIsInfinitelyFar) {
  const SceneRays rays = RaysOf({});
  EXPECT_FALSE(rays.Occluded({0, 0, 0}, {0, 0, 3}, 0.01));
  EXPECT_EQ(rays.DistanceToSurface(Eigen::Vector3d(0, 0, 0)), std::numeric_limits<double>::infinity());
}

TEST(SceneRaysTest, ThreadsGetTheSameAnswers) {
  Rng rng(5);
  const SceneRays rays = RaysOf(RandomQuads(rng, 2000, 80));
  std::vector<Eigen::Vector3d> points;
  for (int i = 0; i < 500; ++i) points.push_back(RandomPoint(rng, 30));
  const auto expected = rays.DistanceToSurface(points);
  std::vector<std::vector<double>> answers(3);
  {
    std::vector<std::jthread> threads;
    for (auto& answer : answers) threads.emplace_back([&] { answer = rays.DistanceToSurface(points); });
  }
  for (const auto& answer : answers) EXPECT_EQ(answer, expected);
}

}  // namespace
}  // namespace mapp::sim
