#include "sim/bake_lights.h"

#include "tests/unit/sim/scenes.h"

#include <gtest/gtest.h>

#include <cmath>
#include <limits>
#include <memory>

namespace mapp::sim {
namespace {

Quad Floor() { return PlainQuad({-5, 5, 0}, {10, 0, 0}, {0, -10, 0}); }
constexpr int kColumns = 21;

float NodeAt(const LightGrid& grid, double x_m, double y_m) {
  const auto column = static_cast<size_t>(std::lround((x_m + 5) * 2));
  const auto row = static_cast<size_t>(std::lround((5 - y_m) * 2));
  return grid.factors.at(row * kColumns + column);
}

TEST(BakeLightsTest, NodesStandAtMostTheSpacingApart) {
  Scene scene{{Floor(), PlainQuad({0, 0, 1}, {0.2, 0, 0}, {0, 0, -1.3})}};
  BakeLights(scene, {}, 0.4, {.spacing_m = 0.5});
  EXPECT_EQ(scene.quads[0].light.columns, kColumns);
  EXPECT_EQ(scene.quads[0].light.rows, kColumns);
  EXPECT_EQ(scene.quads[1].light.columns, 2);
  EXPECT_EQ(scene.quads[1].light.rows, 4);
  for (const Quad& quad : scene.quads) {
    ASSERT_EQ(quad.light.factors.size(), static_cast<size_t>(quad.light.columns * quad.light.rows));
    for (const float factor : quad.light.factors) EXPECT_FLOAT_EQ(factor, 0.4F);
  }
}

TEST(BakeLightsTest, ALampFollowsLambertAndItsReach) {
  Scene scene{{Floor()}};
  const Light lamp{.p_world = {0, 0, 3}, .strength = 0.8, .reach_m = 6};
  BakeLights(scene, {&lamp, 1}, 0.3);
  const LightGrid& grid = scene.quads[0].light;
  EXPECT_NEAR(NodeAt(grid, 0, 0), 0.3 + 0.8 / (1 + 0.25), 1e-5);
  EXPECT_NEAR(NodeAt(grid, 4, 0), 0.3 + 0.8 * (3.0 / 5.0) / (1 + 25.0 / 36.0), 1e-5);
}

TEST(BakeLightsTest, BehindAnOccluderOnlyItsLightIsMissing) {
  // A plate of 1 m x 1 m, 1 m above the floor at x = 2; lamp A, above it, casts its shadow there, lamp B does not.
  Scene scene{{Floor(), PlainQuad({1.5, 0.5, 1}, {1, 0, 0}, {0, -1, 0})}};
  const std::vector<Light> lamps = {{.p_world = {2, 0, 3}, .strength = 0.8, .reach_m = 6},
                                    {.p_world = {-3, 0, 1}, .strength = 0.5, .reach_m = 10}};
  BakeLights(scene, lamps, 0.3);
  const LightGrid& grid = scene.quads[0].light;
  const double lamp_b = 0.5 * (1 / std::sqrt(26.0)) / (1 + 26.0 / 100.0);
  EXPECT_NEAR(NodeAt(grid, 2, 0), 0.3 + lamp_b, 1e-5);
  // The shadow ends 0.75 m from its middle: the plate's half width times 3 / 2.
  const double lamp_b_at_1 = 0.5 * (1 / std::sqrt(1 + 36.0)) / (1 + 37.0 / 100.0);
  EXPECT_NEAR(NodeAt(grid, 3, 0), 0.3 + lamp_b_at_1 + 0.8 * (3 / std::sqrt(10.0)) / (1 + 10.0 / 36.0), 1e-5);
}

TEST(BakeLightsTest, SurfacesTurnedAwayGetAmbientOnly) {
  Scene scene{{PlainQuad({-1, -1, 0}, {2, 0, 0}, {0, 2, 0})}};  // front down
  const Light lamp{.p_world = {0, 0, 3}};
  BakeLights(scene, {&lamp, 1}, 0.25);
  for (const float factor : scene.quads[0].light.factors) EXPECT_FLOAT_EQ(factor, 0.25F);
}

TEST(BakeLightsTest, TheSunIsEquallyStrongEverywhereAndCastsShadows) {
  Scene scene{{Floor(), PlainQuad({-1, 1, 2}, {2, 0, 0}, {0, -2, 0})}};
  const Light sun{.p_world = {1e8, 0, 1e8}, .strength = 0.6, .reach_m = std::numeric_limits<double>::infinity()};
  BakeLights(scene, {&sun, 1}, 0.4);
  const LightGrid& grid = scene.quads[0].light;
  EXPECT_NEAR(NodeAt(grid, 4, 4), 0.4 + 0.6 * std::sqrt(0.5), 1e-4);
  EXPECT_NEAR(NodeAt(grid, -4, -4), 0.4 + 0.6 * std::sqrt(0.5), 1e-4);
  EXPECT_NEAR(NodeAt(grid, -2, 0), 0.4, 1e-4) << "the plate's shadow, 2 m towards negative x";
  EXPECT_NEAR(NodeAt(grid, 0, 0), 0.4 + 0.6 * std::sqrt(0.5), 1e-4) << "below the plate";
}

TEST(BakeLightsTest, ThreadsDoNotChangeIt) {
  const auto bake = [](int num_threads) {
    Scene scene{{Floor(), PlainQuad({1.5, 0.5, 1}, {1, 0, 0}, {0, -1, 0})}};
    const Light lamp{.p_world = {2, 0, 3}};
    BakeLights(scene, {&lamp, 1}, 0.3, {.num_threads = num_threads});
    return scene.quads[0].light.factors;
  };
  EXPECT_EQ(bake(1), bake(3));
}

}  // namespace
}  // namespace mapp::sim
