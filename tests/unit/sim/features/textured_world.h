#pragma once

#include "sim/features/feature_camera.h"
#include "sim/paint.h"
#include "sim/scene.h"
#include "sim/world/world.h"

#include <cstdint>
#include <memory>
#include <utility>

namespace mapp::sim {

inline constexpr int64_t kSecond = 1'000'000'000;

inline std::shared_ptr<const Texture> BrickTexture(uint64_t seed, double width_m, double height_m) {
  constexpr double kTexelsPerM = 250;
  Rng rng(seed);
  return std::make_shared<const Texture>(PaintBricks({width_m, height_m, kTexelsPerM}, rng));
}

/// A wall upright at y = `y_m`, `width_m` wide around x = 0 and 3 m high, seen from smaller y.
inline Quad WallAt(double y_m, double width_m, std::shared_ptr<const Texture> texture) {
  return {.corner_world = {-width_m / 2, y_m, 3},
          .edge_u_world = {width_m, 0, 0},
          .edge_v_world = {0, 0, -3},
          .texture = std::move(texture)};
}

/// A camera at (x, y, 1.5) that looks along +y, turned by `yaw` radians about the vertical.
inline Pose3 Look(double x, double y, double yaw = 0) {
  Eigen::Matrix3d R_world_camera;
  R_world_camera << 1, 0, 0, 0, 0, 1, 0, -1, 0;
  return Pose3(Eigen::AngleAxisd(yaw, Eigen::Vector3d::UnitZ()) * Eigen::Quaterniond(R_world_camera), {x, y, 1.5});
}

inline CameraRig TestRig(SensorKind sensor = SensorKind::kRgbd) {
  CameraRig rig;
  rig.name = "test";
  rig.sensor = sensor;
  rig.camera.projection = PinholeCamera{.fx = 500, .fy = 500, .cx = 319.5, .cy = 239.5};
  rig.camera.width_px = 640;
  rig.camera.height_px = 480;
  if (sensor == SensorKind::kStereo) {
    rig.right_camera = rig.camera;
    rig.T_left_right = Pose3(Eigen::Quaterniond::Identity(), {0.11, 0, 0});
  }
  return rig;
}

inline std::shared_ptr<const FeatureWorld> MakeFeatureWorld(World world) {
  return std::make_shared<const FeatureWorld>(std::make_shared<const World>(std::move(world)));
}

/// A brick wall of 12 m at y = 3 m.
inline World WallWorld() {
  World world;
  world.surroundings.quads.push_back(WallAt(3, 12, BrickTexture(1, 12, 3)));
  return world;
}

}  // namespace mapp::sim
