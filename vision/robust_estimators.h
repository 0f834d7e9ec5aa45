#pragma once

#include "mapp/camera/camera_model.h"
#include "mapp/geometry/pose3.h"

#include <Eigen/Core>

#include <cstdint>
#include <optional>
#include <span>
#include <vector>

namespace mapp {

struct RansacOptions {
  int max_iterations = 500;
  double success_probability = 0.999;  ///< ends early when reached
  int min_inliers = 15;
  uint64_t seed = 1;  ///< the same seed gives the same result
};

struct RigidResult {
  Sim3 T_target_source;
  std::vector<bool> inliers;
  int num_inliers = 0;
};

/// Similarity (or rigid motion) between 3-D point pairs by RANSAC on 3 pairs, refined on all inliers.
/// A pair agrees when |target - S * source| < tolerances[i] (metres). nullopt without consensus: a normal outcome.
std::optional<RigidResult> EstimateRigid(std::span<const Eigen::Vector3d> source,
                                         std::span<const Eigen::Vector3d> target, std::span<const double> tolerances_m,
                                         bool with_scale, const RansacOptions& options);

struct PnpResult {
  Pose3 T_world_camera;
  std::vector<bool> inliers;
  int num_inliers = 0;
};

/// Camera pose from points and undistorted pixels by RANSAC (minimal P3P/SQPnP solver), refined on the inliers.
std::optional<PnpResult> EstimatePose(const PinholeCamera& camera, std::span<const Eigen::Vector3d> p_world,
                                      std::span<const Eigen::Vector2d> pixels, double max_error_px,
                                      const RansacOptions& options);

}  // namespace mapp
