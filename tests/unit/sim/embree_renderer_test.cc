#include "sim/renderer.h"
#include "tests/unit/sim/scenes.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <memory>
#include <optional>
#include <thread>

namespace mapp::sim {
namespace {

/// As strong as that of EuRoC's cameras. Its size divides into no whole cells.
Camera BentCamera() { return {RadialTangentialCamera{61, 60, 50.2, 32.1, -0.283, 0.074, 0.0002, 0.0003}, 101, 67}; }

struct View {
  Camera camera = SmallCamera();
  Pose3 T_world_camera{};
  EmbreeOptions options{.num_threads = 1};
  std::vector<Quad> moving_quads{};
};

RenderedFrame Draw(Scene scene, const View& view) {
  auto frame = MakeEmbreeRenderer(std::make_shared<const Scene>(std::move(scene)), view.options)
                   ->Render(view.camera, view.T_world_camera, view.moving_quads);
  EXPECT_TRUE(frame.ok()) << frame.status();
  return *std::move(frame);
}

/// A texture that rises along u from 0 to 255 gives back u from the level.
std::shared_ptr<const Texture> RampTexture() {
  GrayImage ramp(256, 1);
  for (int x = 0; x < 256; ++x) ramp.at(x, 0) = static_cast<uint8_t>(x);
  return std::make_shared<const Texture>(ramp);
}

TEST(EmbreeRendererTest, AWallHasItsLevelAndDepthEverywhere) {
  for (const Camera& camera : {SmallCamera(), BentCamera()}) {
    const RenderedFrame frame = Draw(OneWall(2.5, 120), {.camera = camera});
    ASSERT_EQ(frame.gray.width, camera.width_px);
    ASSERT_EQ(frame.depth_m.height, camera.height_px);
    for (const uint8_t level : frame.gray.pixels) ASSERT_EQ(level, 120);
    for (const float depth_m : frame.depth_m.pixels) ASSERT_NEAR(depth_m, 2.5, 1e-5);
    EXPECT_TRUE(frame.color.empty());
  }
}

TEST(EmbreeRendererTest, DepthOfATiltedWallFollowsThePlaneThroughPixelCenters) {
  // The plane z = 3 + x / 2, far beyond the image on all sides.
  Scene scene{{PlainQuad({-5, -20, 0.5}, {10, 0, 5}, {0, 40, 0}, 50)}};
  for (const Camera& camera : {SmallCamera(), BentCamera()}) {
    const RenderedFrame frame = Draw(scene, {.camera = camera});
    for (const int x : {0, 17, 40, 79}) {
      const double ray_x = camera.Unproject({static_cast<double>(x), 10.0}).x();
      EXPECT_NEAR(frame.depth_m.at(x, 10), 3.0 / (1.0 - 0.5 * ray_x), 1e-4) << "x = " << x;
    }
  }
}

TEST(EmbreeRendererTest, PicturesStandWhereTheCameraModelProjectsThem) {
  const Pose3 T_world_camera(ExpSo3({0.1, -0.2, 0.05}), {0.1, 0.2, -0.3});
  const Quad quad{{-4, -4, 2}, {8, 0, 0.5}, {0, 8, 0}, RampTexture()};
  for (const Camera& camera : {SmallCamera(), BentCamera()}) {
    const RenderedFrame frame = Draw(Scene{{quad}}, {.camera = camera, .T_world_camera = T_world_camera});
    for (const double u : {0.45, 0.5, 0.55}) {
      const Eigen::Vector3d p_world = quad.corner_world + u * quad.edge_u_world + 0.5 * quad.edge_v_world;
      const Eigen::Vector3d p_camera = T_world_camera.Inverse() * p_world;
      const Eigen::Vector2d pixel = camera.Project(p_camera);
      ASSERT_TRUE(camera.Contains(pixel));
      const int x = static_cast<int>(std::lround(pixel.x()));
      const int y = static_cast<int>(std::lround(pixel.y()));
      EXPECT_NEAR(frame.gray.at(x, y) / 256.0, u, 0.007) << "one pixel spans 0.003 to 0.006";
      EXPECT_NEAR(frame.depth_m.at(x, y), p_camera.z(), 0.005);
    }
  }
}

TEST(EmbreeRendererTest, AWindowShowsItsPartOfTheTextureAndRepeatsBeyondIt) {
  Quad quad{{-2, -1.5, 2}, {4, 0, 0}, {0, 3, 0}, RampTexture()};
  const auto level_at_u = [&](double u) {
    const RenderedFrame frame = Draw(Scene{{quad}}, {});
    // z = 2, fx = 100, cx = 39.5: 50 pixels a metre, so pixel 39.5 shows u = 0.5.
    return static_cast<double>(frame.gray.at(static_cast<int>(std::lround(39.5 + 200 * (u - 0.5))), 30));
  };
  quad.window = {0.25F, 0, 0.75F, 1};
  EXPECT_NEAR(level_at_u(0.4), 256 * 0.45, 2);
  quad.window = {0.75F, 0, 0.25F, 1};
  EXPECT_NEAR(level_at_u(0.4), 256 * 0.55, 2) << "mirrored";
  quad.window = {3.5F, -2, 5.5F, 7};
  EXPECT_NEAR(level_at_u(0.4), 256 * 0.3, 4) << "3.5 + 0.4 * 2 = 4.3";
  EXPECT_NEAR(level_at_u(0.6), 256 * 0.7, 4) << "3.5 + 0.6 * 2 = 4.7";
}

TEST(EmbreeRendererTest, TheLightGridMultipliesLevelsAndIsBlended) {
  Quad quad = PlainQuad({-2, -1.5, 2}, {4, 0, 0}, {0, 3, 0}, 100);
  quad.light = {3, 2, {0.5F, 1.0F, 1.5F, 0.5F, 1.0F, 1.5F}};  // 0.5 + u
  const RenderedFrame frame = Draw(Scene{{quad}}, {});
  for (const int x : {0, 20, 39, 60, 79}) {
    const double u = 0.5 + (x - 39.5) / 200;
    EXPECT_NEAR(frame.gray.at(x, 30), 100 * (0.5 + u), 0.6) << "x = " << x;
  }
  quad.light.factors = {9, 9, 9, 9, 9, 9};
  EXPECT_EQ(Draw(Scene{{quad}}, {}).gray.at(40, 30), 255) << "too bright is white";
}

TEST(EmbreeRendererTest, EdgesBlendInGrayButNeverInDepth) {
  Scene scene = OneWall(4, 0);
  scene.quads.push_back(PlainQuad({-0.2, -0.3, 2}, {0.41, 0, 0}, {0, 0.6, 0}, 200));  // its right edge cuts pixels
  const RenderedFrame frame = Draw(scene, {});
  bool blended = false;
  for (int x = 0; x < 80; ++x) {
    blended |= frame.gray.at(x, 30) >= 50 && frame.gray.at(x, 30) <= 150;
    const float depth_m = frame.depth_m.at(x, 30);
    EXPECT_TRUE(std::abs(depth_m - 2) < 1e-4 || std::abs(depth_m - 4) < 1e-4) << depth_m;
  }
  EXPECT_TRUE(blended);
}

TEST(EmbreeRendererTest, BacksAndThingsBehindTheCameraAreInvisible) {
  Scene scene{{PlainQuad({50, -50, 2}, {-100, 0, 0}, {0, 100, 0}, 200),     // faces away
               PlainQuad({-50, -50, -2}, {100, 0, 0}, {0, 100, 0}, 200)}};  // behind
  const RenderedFrame frame = Draw(scene, {.options = {.sky_gray = 33, .with_color = true}});
  for (const uint8_t level : frame.gray.pixels) ASSERT_EQ(level, 33);
  for (const float depth_m : frame.depth_m.pixels) ASSERT_EQ(depth_m, 0);
  for (const auto& color : frame.color.pixels) ASSERT_EQ(color, (std::array<uint8_t, 3>{33, 33, 33}));
  // What stands behind a back shows through it.
  scene.quads.push_back(OneWall(3, 90).quads[0]);
  const RenderedFrame through = Draw(scene, {});
  for (const uint8_t level : through.gray.pixels) ASSERT_EQ(level, 90);
}

TEST(EmbreeRendererTest, AFloorThatReachesBehindTheCameraIsClipped) {
  Scene scene{{PlainQuad({-50, 1, 50}, {100, 0, 0}, {0, 0, -100}, 90)}};  // 1 m below the camera
  const RenderedFrame frame = Draw(scene, {});
  EXPECT_EQ(frame.gray.at(40, 59), 90);
  EXPECT_NEAR(frame.depth_m.at(40, 59), 90.0 / 29.5, 1e-3);
  EXPECT_EQ(frame.gray.at(40, 20), 0);  // above the horizon
}

TEST(EmbreeRendererTest, ColorIsGrayTimesTint) {
  Scene scene = OneWall(2, 100);
  scene.quads[0].tint_rgb = {1.0F, 0.5F, 0.2F};
  const RenderedFrame frame = Draw(scene, {.options = {.with_color = true}});
  EXPECT_EQ(frame.gray.at(7, 7), 100);
  EXPECT_EQ(frame.color.at(7, 7), (std::array<uint8_t, 3>{100, 50, 20}));
}

TEST(EmbreeRendererTest, MovingSurfacesHideAndAreHidden) {
  Scene scene = OneWall(4, 40);
  scene.quads.push_back(PlainQuad({-0.4, -0.3, 2}, {0.4, 0, 0}, {0, 0.6, 0}, 200));  // left of the middle
  const RenderedFrame frame = Draw(scene, {.moving_quads = {PlainQuad({-1.5, -0.1, 3}, {3, 0, 0}, {0, 0.2, 0}, 120)}});
  EXPECT_EQ(frame.gray.at(30, 30), 200);
  EXPECT_NEAR(frame.depth_m.at(30, 30), 2, 1e-5);
  EXPECT_EQ(frame.gray.at(60, 30), 120);
  EXPECT_NEAR(frame.depth_m.at(60, 30), 3, 1e-5);
  EXPECT_EQ(frame.gray.at(60, 50), 40);
  // The next frame without them is as before.
  EXPECT_EQ(Draw(scene, {}).gray.at(60, 30), 40);
}

/// Surfaces of 3 cm to 2 m, many of them thinner than the cells that the renderer works in, in front of a wall.
Scene Thicket(uint64_t seed, int count) {
  Rng rng(seed);
  Scene scene;
  for (int i = 0; i < count; ++i) {
    const Eigen::Vector3d middle(rng.Uniform(-4, 4), rng.Uniform(-3, 3), rng.Uniform(1.5, 9));
    Eigen::Vector3d u = RandomPoint(rng, 1).normalized();
    Eigen::Vector3d v = u.cross(RandomPoint(rng, 1)).normalized();
    if (v.cross(u).dot(middle) > 0) u = -u;  // face the camera
    u *= std::exp(rng.Uniform(std::log(0.03), std::log(2.0)));
    v *= std::exp(rng.Uniform(std::log(0.03), std::log(2.0)));
    scene.quads.push_back(PlainQuad(middle - 0.5 * (u + v), u, v, static_cast<uint8_t>(40 + i % 200)));
  }
  scene.quads.push_back(OneWall(10, 20).quads[0]);
  return scene;
}

/// Depth of the nearest surface that a ray of the camera at the origin meets; nullopt if it passes so near an edge that
/// rounding decides.
std::optional<double> TrueDepth(const Scene& scene, const Eigen::Vector3d& ray) {
  double nearest_m = std::numeric_limits<double>::infinity();
  for (const Quad& quad : scene.quads) {
    const Eigen::Vector3d normal = quad.NormalWorld();
    const double z = normal.dot(quad.corner_world) / normal.dot(ray);
    if (z < 0 || normal.dot(ray) >= 0 || z >= nearest_m) continue;
    const Eigen::Vector3d on_plane = z * ray - quad.corner_world;
    const double u = on_plane.dot(quad.edge_u_world) / quad.edge_u_world.norm();
    const double v = on_plane.dot(quad.edge_v_world) / quad.edge_v_world.norm();
    const double inside_m = std::min({u, quad.edge_u_world.norm() - u, v, quad.edge_v_world.norm() - v});
    if (std::abs(inside_m) < 1e-4) return std::nullopt;
    if (inside_m > 0) nearest_m = z;
  }
  return nearest_m;
}

TEST(EmbreeRendererTest, NothingIsMissedAmongManySmallSurfaces) {
  for (const uint64_t seed : {1, 2, 3}) {
    const Scene scene = Thicket(seed, 60);
    for (const Camera& camera : {SmallCamera(), BentCamera()}) {
      const RenderedFrame frame = Draw(scene, {.camera = camera});
      int num_compared = 0;
      for (int y = 0; y < camera.height_px; ++y) {
        for (int x = 0; x < camera.width_px; ++x) {
          const auto expected_m = TrueDepth(scene, camera.Unproject({double(x), double(y)}));
          if (!expected_m) continue;
          ++num_compared;
          ASSERT_NEAR(frame.depth_m.at(x, y), *expected_m, 1e-4 * *expected_m)
              << "seed " << seed << ", pixel " << x << ", " << y << " of " << camera.width_px;
        }
      }
      EXPECT_GT(num_compared, camera.width_px * camera.height_px * 95 / 100);
    }
  }
}

TEST(EmbreeRendererTest, SurfacesThatPierceEachOtherMeetWhereTheirPlanesDo) {
  // A post stuck into a floor, 1 m below the camera.
  Scene scene{
      {PlainQuad({-50, 1, 50}, {100, 0, 0}, {0, 0, -100}, 90), PlainQuad({-0.2, -5, 4}, {0.4, 0, 0}, {0, 10, 0}, 200)}};
  const RenderedFrame frame = Draw(scene, {});
  for (int y = 0; y < 60; ++y) {
    const auto expected_m = TrueDepth(scene, SmallCamera().Unproject({40.0, double(y)}));
    ASSERT_TRUE(expected_m);
    EXPECT_NEAR(frame.depth_m.at(40, y), *expected_m, 1e-3) << y;
  }
}

TEST(EmbreeRendererTest, ThreadsDoNotChangeThePicture) {
  const Scene scene = Thicket(7, 300);
  const View one{.camera = BentCamera(), .options = {.num_threads = 1, .with_color = true}};
  const View three{.camera = BentCamera(), .options = {.num_threads = 3, .with_color = true}};
  const RenderedFrame first = Draw(scene, one);
  const RenderedFrame second = Draw(scene, three);
  EXPECT_EQ(first.gray.pixels, second.gray.pixels);
  EXPECT_EQ(first.depth_m.pixels, second.depth_m.pixels);
  EXPECT_EQ(first.color.pixels, second.color.pixels);
}

TEST(EmbreeRendererTest, ServesSeveralThreadsAndCamerasAtOnce) {
  const auto renderer =
      MakeEmbreeRenderer(std::make_shared<const Scene>(Thicket(8, 100)), {.num_threads = 1, .sky_gray = 5});
  const std::vector<Quad> moving = {PlainQuad({-1, -1, 1.2}, {2, 0, 0}, {0, 0.1, 0}, 120)};
  const auto draw = [&](bool bent) {
    return renderer->Render(bent ? BentCamera() : SmallCamera(), Pose3(), moving)->gray.pixels;
  };
  const auto pinhole = draw(false);
  const auto bent = draw(true);
  std::vector<std::vector<uint8_t>> drawn(6);
  {
    std::vector<std::jthread> threads;
    for (size_t i = 0; i < drawn.size(); ++i) threads.emplace_back([&, i] { drawn[i] = draw(i % 2 == 1); });
  }
  for (size_t i = 0; i < drawn.size(); ++i) EXPECT_EQ(drawn[i], i % 2 == 1 ? bent : pinhole) << i;
}

TEST(EmbreeRendererTest, RefusesABadCamera) {
  const auto renderer = MakeEmbreeRenderer(std::make_shared<const Scene>(), {});
  Camera camera = SmallCamera();
  camera.projection = PinholeCamera{0, 90, 39.5, 29.5};
  EXPECT_EQ(renderer->Render(camera, Pose3()).status().code(), absl::StatusCode::kInvalidArgument);
}

}  // namespace
}  // namespace mapp::sim
