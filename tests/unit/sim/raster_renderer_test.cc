#include "sim/renderer.h"
#include "tests/unit/sim/scenes.h"

#include <gtest/gtest.h>

#include <cmath>
#include <memory>

namespace mapp::sim {
namespace {

StatusOr<RenderedFrame> Render(Scene scene, const Pose3& T_world_camera = Pose3(), int num_threads = 1) {
  return MakeRasterRenderer(std::make_shared<const Scene>(std::move(scene)), num_threads)
      ->Render(SmallCamera(), T_world_camera);
}

TEST(RasterRendererTest, AWallHasItsLevelAndDepthEverywhere) {
  const auto frame = Render(OneWall(2.5, 120));
  ASSERT_TRUE(frame.ok()) << frame.status();
  for (int y = 0; y < 60; ++y) {
    for (int x = 0; x < 80; ++x) {
      ASSERT_EQ(frame->gray.at(x, y), 120);
      ASSERT_NEAR(frame->depth_m.at(x, y), 2.5, 1e-5);
    }
  }
}

TEST(RasterRendererTest, DepthOfATiltedWallFollowsThePlaneThroughPixelCenters) {
  // The plane z = 3 + x / 2, far beyond the image on all sides.
  Scene scene{{PlainQuad({-5, -20, 0.5}, {10, 0, 5}, {0, 40, 0}, 50)}};
  const auto frame = Render(scene);
  ASSERT_TRUE(frame.ok()) << frame.status();
  for (const int x : {0, 17, 40, 79}) {
    const double ray_x = SmallCamera().Unproject({static_cast<double>(x), 10.0}).x();
    EXPECT_NEAR(frame->depth_m.at(x, 10), 3.0 / (1.0 - 0.5 * ray_x), 1e-4) << "x = " << x;
  }
}

TEST(RasterRendererTest, PicturesStandWhereTheCameraModelProjectsThem) {
  // A texture that rises along u from 0 to 255 gives back u from the level.
  GrayImage ramp(256, 1);
  for (int x = 0; x < 256; ++x) ramp.at(x, 0) = static_cast<uint8_t>(x);
  const Pose3 T_world_camera(ExpSo3({0.1, -0.2, 0.05}), {0.1, 0.2, -0.3});
  const Quad quad{{-4, -4, 2}, {8, 0, 0.5}, {0, 8, 0}, std::make_shared<const Texture>(ramp)};
  const auto frame = Render(Scene{{quad}}, T_world_camera);
  ASSERT_TRUE(frame.ok()) << frame.status();
  for (const double u : {0.45, 0.5, 0.55}) {
    const Eigen::Vector3d p_world = quad.corner_world + u * quad.edge_u_world + 0.5 * quad.edge_v_world;
    const Eigen::Vector3d p_camera = T_world_camera.Inverse() * p_world;
    const Eigen::Vector2d pixel = SmallCamera().Project(p_camera);
    ASSERT_TRUE(SmallCamera().Contains(pixel));
    const int x = static_cast<int>(std::lround(pixel.x()));
    const int y = static_cast<int>(std::lround(pixel.y()));
    EXPECT_NEAR(frame->gray.at(x, y) / 256.0, u, 0.006) << "one pixel spans 0.003 to 0.004";
    EXPECT_NEAR(frame->depth_m.at(x, y), p_camera.z(), 0.005);
  }
}

TEST(RasterRendererTest, TheNearerSurfaceHidesTheFartherInAnyOrder) {
  for (const bool near_first : {true, false}) {
    Scene scene = OneWall(4, 40);
    scene.quads.insert(near_first ? scene.quads.begin() : scene.quads.end(),
                       PlainQuad({-0.2, -0.2, 2}, {0.4, 0, 0}, {0, 0.4, 0}, 200));
    const auto frame = Render(scene);
    ASSERT_TRUE(frame.ok()) << frame.status();
    EXPECT_EQ(frame->gray.at(40, 30), 200);
    EXPECT_NEAR(frame->depth_m.at(40, 30), 2, 1e-5);
    EXPECT_EQ(frame->gray.at(5, 5), 40);
    EXPECT_NEAR(frame->depth_m.at(5, 5), 4, 1e-5);
  }
}

TEST(RasterRendererTest, EdgesBlendInGrayButNeverInDepth) {
  Scene scene = OneWall(4, 0);
  scene.quads.push_back(PlainQuad({-0.2, -0.3, 2}, {0.41, 0, 0}, {0, 0.6, 0}, 200));  // its right edge cuts pixels
  const auto frame = Render(scene);
  ASSERT_TRUE(frame.ok()) << frame.status();
  bool blended = false;
  for (int x = 0; x < 80; ++x) {
    blended |= frame->gray.at(x, 30) == 100;
    const float depth_m = frame->depth_m.at(x, 30);
    EXPECT_TRUE(std::abs(depth_m - 2) < 1e-4 || std::abs(depth_m - 4) < 1e-4) << depth_m;
  }
  EXPECT_TRUE(blended);
}

TEST(RasterRendererTest, BacksAndThingsBehindTheCameraAreInvisible) {
  Scene scene{{PlainQuad({50, -50, 2}, {-100, 0, 0}, {0, 100, 0}, 200),     // faces away
               PlainQuad({-50, -50, -2}, {100, 0, 0}, {0, 100, 0}, 200)}};  // behind
  const auto frame = Render(scene);
  ASSERT_TRUE(frame.ok()) << frame.status();
  for (const uint8_t level : frame->gray.pixels) ASSERT_EQ(level, 0);
  for (const float depth_m : frame->depth_m.pixels) ASSERT_EQ(depth_m, 0);
}

TEST(RasterRendererTest, AFloorThatReachesBehindTheCameraIsClipped) {
  Scene scene{{PlainQuad({-50, 1, 50}, {100, 0, 0}, {0, 0, -100}, 90)}};  // 1 m below the camera
  const auto frame = Render(scene);
  ASSERT_TRUE(frame.ok()) << frame.status();
  EXPECT_EQ(frame->gray.at(40, 59), 90);
  EXPECT_NEAR(frame->depth_m.at(40, 59), 90.0 / 29.5, 1e-3);
  EXPECT_EQ(frame->gray.at(40, 20), 0);  // above the horizon
}

TEST(RasterRendererTest, ThreadsDoNotChangeThePicture) {
  Scene scene{{PlainQuad({-5, -20, 0.5}, {10, 0, 5}, {0, 40, 0}, 50),
               PlainQuad({-0.2, -0.2, 2}, {0.4, 0, 0}, {0, 0.4, 0}, 200)}};
  const auto one = Render(scene, Pose3(), 1);
  const auto three = Render(scene, Pose3(), 3);
  ASSERT_TRUE(one.ok() && three.ok());
  EXPECT_EQ(one->gray.pixels, three->gray.pixels);
  EXPECT_EQ(one->depth_m.pixels, three->depth_m.pixels);
}

TEST(RasterRendererTest, RefusesCamerasItCannotDraw) {
  const auto renderer = MakeRasterRenderer(std::make_shared<const Scene>(), 1);
  Camera camera = SmallCamera();
  camera.projection = RadialTangentialCamera{100, 90, 39.5, 29.5, -0.3, 0.1, 0, 0};
  EXPECT_EQ(renderer->Render(camera, Pose3()).status().code(), absl::StatusCode::kInvalidArgument);
  camera.projection = PinholeCamera{0, 90, 39.5, 29.5};
  EXPECT_EQ(renderer->Render(camera, Pose3()).status().code(), absl::StatusCode::kInvalidArgument);
}

TEST(SceneTest, BoxesShowTheirOutsideFromEverySide) {
  const Lamp lamp{.p_world = {0, 0, 3}};
  Scene scene;
  const Painter gray = [](double, double) { return GrayImage(4, 4, 150); };
  AddBox({.center_world = {0, 0, 1}, .size_m = {1.0, 0.6, 0.4}, .yaw = 0.5}, gray, lamp, scene);
  ASSERT_EQ(scene.quads.size(), 6);
  for (const Quad& quad : scene.quads) {
    const Eigen::Vector3d middle = quad.corner_world + 0.5 * (quad.edge_u_world + quad.edge_v_world);
    const Eigen::Vector3d outward = middle - Eigen::Vector3d(0, 0, 1);
    EXPECT_GT(quad.NormalWorld().dot(outward.normalized()), 0.999);
    EXPECT_NEAR(quad.edge_u_world.dot(quad.edge_v_world), 0, 1e-12);
  }
}

TEST(SceneTest, BoxesOnTheFloorHaveNoBottom) {
  Scene scene;
  const Painter gray = [](double, double) { return GrayImage(4, 4, 150); };
  AddBox({.center_world = {0, 0, 0.2}, .size_m = {1, 1, 0.4}}, gray, Lamp{.p_world = {0, 0, 3}}, scene);
  EXPECT_EQ(scene.quads.size(), 5);
}

}  // namespace
}  // namespace mapp::sim
