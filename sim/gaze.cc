#include "sim/gaze.h"

namespace mapp::sim {

Eigen::Quaterniond LookAlong(double yaw, double pitch_down, double roll) {
  Eigen::Matrix3d R_world_level;  // optical axis along world x, image upright
  R_world_level << 0, 0, 1, -1, 0, 0, 0, -1, 0;
  const Eigen::Matrix3d R_world_camera = Eigen::AngleAxisd(yaw, Eigen::Vector3d::UnitZ()) * R_world_level *
                                         Eigen::AngleAxisd(-pitch_down, Eigen::Vector3d::UnitX()) *
                                         Eigen::AngleAxisd(roll, Eigen::Vector3d::UnitZ());
  return Eigen::Quaterniond(R_world_camera);
}

}  // namespace mapp::sim
