#pragma once

#include "mapp/base/id.h"
#include "mapp/feature/feature.h"
#include "mapp/geometry/pose3.h"

#include <Eigen/Core>

#include <memory>
#include <vector>

namespace mapp {

/// A map point received from the server, in the device's own odometry frame.
struct SharedPoint {
  MapPointId id;
  Eigen::Vector3d p_session = Eigen::Vector3d::Zero();                ///< metres
  Eigen::Vector3f view_direction_session = Eigen::Vector3f::UnitZ();  ///< unit, mean of (point - observing camera)
  OrbDescriptor descriptor;
  float reference_distance_m = 1;  ///< detected at octave o from reference / 1.2^o
  uint16_t num_observations = 1;
};

/// The map around the device as the server shared it (DESIGN 9), fixed in the session's frame by the T_map_session at
/// which it was received. Immutable.
struct SharedMap {
  std::vector<SharedPoint> points;
  Pose3 T_map_session;
  /// Grows with every shared map a session receives; 1 is the first.
  uint32_t number = 0;
};

}  // namespace mapp
