#pragma once

#include <Eigen/Geometry>

namespace mapp::sim {

/// R_world_camera of a camera (x right, y down, z forward) in a world whose z is up. `yaw`: direction of the optical
/// axis about z, from world x; then `pitch_down` about the image's x, then `roll` about the optical axis. Radians.
Eigen::Quaterniond LookAlong(double yaw, double pitch_down, double roll);

}  // namespace mapp::sim
