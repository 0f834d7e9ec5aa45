#pragma once

#include "datasets/sequence.h"
#include "mapp/base/status.h"
#include "sim/world/camera_rig.h"
#include "sim/world/world.h"

#include <Eigen/Core>

#include <cstdint>
#include <memory>
#include <string>
#include <vector>

namespace mapp::sim {

/// One reading of an IMU, in the body frame.
struct ImuSample {
  int64_t stamp_ns = 0;
  Eigen::Vector3d angular_velocity_body;  ///< rad/s
  Eigen::Vector3d acceleration_body;      ///< m/s^2, gravity included (an IMU at rest reads +9.81 upwards)
};

/// One user's way through the world.
struct Visit {
  int user = 0;
  CameraRig rig;
  std::vector<StampedPose> poses;  ///< T_world_camera at each image, by increasing time
  std::vector<ImuSample> imu;      ///< with bias and noise; covers the images
  double path_m = 0;               ///< length of the way
};

struct SimulationOptions {
  std::string setting = "garage";
  int num_users = 2;   ///< [1, 10000]
  double path_m = 60;  ///< length of each user's way, (0, 10000]; ignored where trajectories are given
  uint64_t seed = 1;
  std::vector<std::string> cameras;  ///< dealt out to the users in turn; empty: the setting's own
  SensorKind sensor = SensorKind::kRgbd;
  double rate_hz = 0;  ///< images a second; 0: the camera's
  int num_changes = 0;
  int num_passers = 0;
  std::string textures_folder;
  std::vector<std::string> trajectory_files;  ///< TUM, T_world_camera: users fly these instead of ways of their own
};

/// A world and who visits it. User k comes an hour after user k - 1, so changes can happen between.
struct Simulation {
  SimulationOptions options;
  std::shared_ptr<const World> world;
  std::vector<Visit> visits;
};

/// INVALID_ARGUMENT naming the option; also a trajectory that leaves the world, with the time and place where.
StatusOr<std::shared_ptr<const Simulation>> Simulate(const SimulationOptions& options);

}  // namespace mapp::sim
