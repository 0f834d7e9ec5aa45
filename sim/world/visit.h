#pragma once

#include "datasets/sequence.h"
#include "mapp/base/status.h"
#include "sim/world/camera_rig.h"
#include "sim/world/imu.h"
#include "sim/world/world.h"

#include <cstdint>
#include <memory>
#include <string>
#include <vector>

namespace mapp::sim {

/// One user's way through the world.
struct Visit {
  int user = 0;
  CameraRig rig;
  std::vector<StampedPose> poses;  ///< T_world_camera at each image, by increasing time
  std::vector<ImuSample> imu;      ///< with bias and noise; covers the images. Stereo and mono-inertial only
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
  double change_reach_m = 0;             ///< only what lies within this of some user's way changes; 0: all may
  int num_stable_visits = 0;             ///< nothing changes before the end of so many visits
  std::vector<ChangeKind> change_kinds;  ///< what may happen; empty: everything
  std::string textures_folder;
  /// TUM, T_world_camera: users fly these, in turn, instead of ways of their own; times count from the visit's start.
  std::vector<std::string> trajectory_files;
  double max_duration_s = 0;  ///< given trajectories are cut after so long; 0: they are not
  /// So many different ways; user k walks that of user k mod num_routes again, in his own time and manner. 0: everybody
  /// has his own.
  int num_routes = 0;
};

/// A world and who visits it. User k comes an hour after user k - 1 (or more hours, where visits take longer), so
/// changes can happen between.
struct Simulation {
  SimulationOptions options;
  std::shared_ptr<const World> world;
  std::vector<Visit> visits;
};

/// INVALID_ARGUMENT naming the option; also a trajectory that leaves the world, with the time and place where.
/// NOT_FOUND: no such trajectory or folder. The same options give the same simulation; a visit's way does not depend on
/// how many visits follow.
StatusOr<std::shared_ptr<const Simulation>> Simulate(const SimulationOptions& options);

/// The visits alone, through a world made by the caller; `options` says the rest. Errors as Simulate().
StatusOr<std::vector<Visit>> PlanVisits(const World& world, const SimulationOptions& options);

}  // namespace mapp::sim
