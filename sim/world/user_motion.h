#pragma once

#include "datasets/sequence.h"
#include "sim/world/world.h"

#include <cstddef>
#include <cstdint>
#include <vector>

namespace mapp::sim {

/// How a device moves.
struct Gait {
  double speed_m_s = 1.4;
  double max_lateral_m_s2 = 1.2;  ///< slower in curves
  double pitch_down = 0.09;       ///< of the camera, radians
  double pitch_swing = 0.03;      ///< looks up and down by this
  double yaw_swing = 0.2;         ///< looks left and right by this
  double roll_swing = 0.01;
  double bob_m = 0;   ///< up and down with each step, amplitude
  double rise_m = 0;  ///< slowly up and down, amplitude
};

/// A person with a hand-held camera, and a drone; users differ a little.
Gait WalkingGait(uint64_t seed);
Gait FlyingGait(uint64_t seed);

/// Fastest turn of a camera about the vertical, radians a second.
inline constexpr double kMaxYawRate = 0.69;

/// T_world_camera every 50 ms from `start_ns` on, along the first `path_m` metres of a walk of at least 5 m (see
/// PlanWalks()). The way is a smooth curve that leaves the edges by less than the graph's clearance; it begins slowly,
/// slows down in curves, and the camera looks along it, turning at most kMaxYawRate.
std::vector<StampedPose> MoveAlong(const RouteGraph& graph, const std::vector<size_t>& walk, double path_m,
                                   const Gait& gait, int64_t start_ns, uint64_t seed);

}  // namespace mapp::sim
