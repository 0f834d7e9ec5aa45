// Frames a second of the renderer: gray and depth, 752 x 480, in a hall like a garage of some thousand rectangles.
#include "mapp/base/check.h"
#include "mapp/base/rng.h"
#include "sim/paint.h"
#include "sim/renderer.h"

#include <Eigen/Geometry>
#include <benchmark/benchmark.h>

#include <cmath>

namespace mapp::sim {
namespace {

constexpr double kWidth_m = 45;
constexpr double kLength_m = 175;
constexpr double kHeight_m = 2.8;

std::shared_ptr<const Texture> Painted(GrayImage (*paint)(const Canvas&, Rng&), Rng& rng) {
  return std::make_shared<const Texture>(paint({4, 4, 256}, rng));
}

/// The front of a rectangle whose picture repeats every 4 m.
Quad Wall(const Eigen::Vector3d& corner, const Eigen::Vector3d& edge_u, const Eigen::Vector3d& edge_v,
          std::shared_ptr<const Texture> texture) {
  Quad quad{corner, edge_u, edge_v, std::move(texture)};
  quad.window = {0, 0, static_cast<float>(edge_u.norm() / 4), static_cast<float>(edge_v.norm() / 4)};
  quad.light = {2, 2, {0.9F, 0.7F, 0.8F, 0.9F}};
  return quad;
}

void AddBoxTo(const Eigen::Vector3d& center, const Eigen::Vector3d& size, const std::shared_ptr<const Texture>& texture,
              Scene& scene) {
  Scene box;
  AddBox(
      {center, size}, [](double, double) { return GrayImage(1, 1); }, Lamp{.p_world = {0, 0, 0}}, box);
  for (Quad& quad : box.quads)
    scene.quads.push_back(Wall(quad.corner_world, quad.edge_u_world, quad.edge_v_world, texture));
}

/// Floor, ceiling and walls; pillars; parked cars of two boxes and four wheels; pipes below the ceiling.
std::shared_ptr<const Scene> Garage() {
  Rng rng(1);
  auto scene = std::make_shared<Scene>();
  const auto concrete = Painted(PaintConcrete, rng);
  const auto plates = Painted(PaintPlates, rng);
  const auto bricks = Painted(PaintBricks, rng);
  const auto carton = Painted(PaintCarton, rng);
  scene->quads.push_back(Wall({0, kLength_m, 0}, {kWidth_m, 0, 0}, {0, -kLength_m, 0}, concrete));
  scene->quads.push_back(Wall({0, 0, kHeight_m}, {kWidth_m, 0, 0}, {0, kLength_m, 0}, plates));
  scene->quads.push_back(Wall({0, kLength_m, kHeight_m}, {kWidth_m, 0, 0}, {0, 0, -kHeight_m}, bricks));
  scene->quads.push_back(Wall({kWidth_m, 0, kHeight_m}, {-kWidth_m, 0, 0}, {0, 0, -kHeight_m}, bricks));
  scene->quads.push_back(Wall({0, 0, kHeight_m}, {0, kLength_m, 0}, {0, 0, -kHeight_m}, concrete));
  scene->quads.push_back(Wall({kWidth_m, kLength_m, kHeight_m}, {0, -kLength_m, 0}, {0, 0, -kHeight_m}, concrete));
  for (double y = 5; y < kLength_m; y += 7.5) {
    for (const double x : {7.5, 15.0, 22.5, 30.0, 37.5}) {
      AddBoxTo({x, y, 0.5 * kHeight_m}, {0.5, 0.5, kHeight_m}, concrete, *scene);
    }
    for (const double x : {2.6, 11.5, 18.5, 26.5, 33.5, 42.4}) {
      for (const double along : {1.5, 4.2}) {
        AddBoxTo({x, y + along, 0.65}, {4.3, 1.75, 0.7}, plates, *scene);
        AddBoxTo({x, y + along, 1.2}, {2.4, 1.6, 0.5}, carton, *scene);
        for (const double wheel_x : {-1.4, 1.4}) {
          for (const double wheel_y : {-0.8, 0.8}) {
            AddBoxTo({x + wheel_x, y + along + wheel_y, 0.3}, {0.6, 0.2, 0.6}, bricks, *scene);
          }
        }
      }
    }
    AddBoxTo({22.5, y, kHeight_m - 0.3}, {kWidth_m, 0.12, 0.12}, plates, *scene);
  }
  return scene;
}

void BM_RenderGarage(benchmark::State& state) {
  static const std::shared_ptr<const Scene> scene = Garage();
  const auto renderer = MakeEmbreeRenderer(scene, {.num_threads = static_cast<int>(state.range(0))});
  Camera camera{PinholeCamera{458, 457, 375.5, 239.5}, 752, 480};
  if (state.range(1) != 0) {
    camera.projection = RadialTangentialCamera{458, 457, 367, 248, -0.283, 0.074, 0.0002, 0.00002};
  }
  Eigen::Matrix3d R_world_level;  // optical axis along world y, image upright
  R_world_level << 1, 0, 0, 0, 0, 1, 0, -1, 0;
  int frame = 0;
  for (auto _ : state) {
    // Along the aisle, looking left and right.
    const double yaw = 0.9 * std::sin(0.11 * frame);
    const Eigen::Matrix3d R = Eigen::AngleAxisd(yaw, Eigen::Vector3d::UnitZ()) * R_world_level;
    const Pose3 T_world_camera(Eigen::Quaterniond(R), {14.9 + 7.2, 2 + std::fmod(0.37 * frame, 150.0), 1.5});
    const auto image = renderer->Render(camera, T_world_camera);
    MAPP_CHECK(image.ok());
    benchmark::DoNotOptimize(image->gray.pixels.data());
    ++frame;
  }
  state.counters["frames/s"] = benchmark::Counter(static_cast<double>(state.iterations()), benchmark::Counter::kIsRate);
  state.counters["quads"] = static_cast<double>(scene->quads.size());
}
BENCHMARK(BM_RenderGarage)
    ->ArgNames({"threads", "distorted"})
    ->Args({1, 0})
    ->Args({2, 0})
    ->Args({1, 1})
    ->Args({2, 1})
    ->Unit(benchmark::kMillisecond)
    ->MeasureProcessCPUTime()
    ->UseRealTime();

}  // namespace
}  // namespace mapp::sim
