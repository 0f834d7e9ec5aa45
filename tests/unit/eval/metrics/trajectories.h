#pragma once

#include "datasets/sequence.h"
#include "mapp/base/rng.h"

#include <cmath>
#include <vector>

namespace mapp {

/// A curve that is no line and no plane figure, 10 Hz; turns by 0.1 rad a pose.
inline std::vector<StampedPose> Curve(size_t num_poses) {
  std::vector<StampedPose> poses;
  for (size_t i = 0; i < num_poses; ++i) {
    const double s = 0.1 * static_cast<double>(i);
    const Pose3 pose(ExpSo3({0, s, 0}), {std::cos(s), std::sin(2 * s), 0.3 * s});
    poses.push_back({static_cast<int64_t>(i) * 100'000'000, pose});
  }
  return poses;
}

/// Straight along x at `speed_m_s`, 10 Hz, looking ahead without turning.
inline std::vector<StampedPose> Straight(size_t num_poses, double speed_m_s) {
  std::vector<StampedPose> poses;
  for (size_t i = 0; i < num_poses; ++i) {
    const Eigen::Vector3d p_world(0.1 * speed_m_s * static_cast<double>(i), 0, 0);
    poses.push_back({static_cast<int64_t>(i) * 100'000'000, Pose3(Eigen::Quaterniond::Identity(), p_world)});
  }
  return poses;
}

/// In another frame and at another scale.
inline std::vector<StampedPose> Moved(const Pose3& T_other_world, double scale, std::vector<StampedPose> poses) {
  for (StampedPose& pose : poses) {
    const Pose3 scaled(pose.T_world_camera.rotation(), scale * pose.T_world_camera.translation());
    pose.T_world_camera = T_other_world * scaled;
  }
  return poses;
}

/// Every position off by normal noise of `sigma_m` an axis.
inline std::vector<StampedPose> Shaken(std::vector<StampedPose> poses, double sigma_m, Rng& rng) {
  for (StampedPose& pose : poses) {
    const Eigen::Vector3d noise_m(rng.Normal(), rng.Normal(), rng.Normal());
    pose.T_world_camera = Pose3(Eigen::Quaterniond::Identity(), sigma_m * noise_m) * pose.T_world_camera;
  }
  return poses;
}

}  // namespace mapp
