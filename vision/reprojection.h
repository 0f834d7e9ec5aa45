#pragma once

#include "mapp/camera/camera_model.h"
#include "mapp/geometry/pose3.h"

#include <Eigen/Core>

namespace mapp::internal {

/// Points nearer than this to the camera's plane have no usable projection.
inline constexpr double kMinDepth_m = 0.01;

/// chi-square bounds at 95 % for 2 (pixel) and 3 (pixel and disparity) degrees of freedom.
inline constexpr double kChi2Mono = 5.991;
inline constexpr double kChi2Depth = 7.815;
/// The same for 6, a relative pose.
inline constexpr double kChi2RelativePose = 12.592;

/// Cost of an observation behind its camera, in units of its chi-square bound: high enough that no step gains by
/// turning points away, bounded so that a single false match cannot veto a step, constant so that it pulls nowhere.
inline constexpr double kBehindCameraPenalty = 10.0;

/// One measurement of a point: where, how exactly, and perhaps how far.
struct ReprojectionMeasurement {
  Eigen::Vector2d pixel;
  double sigma_px = 1;
  double depth_m = 0;  ///< 0 = none
  double bf_px_m = 0;  ///< the depth weighs as the disparity bf / z
};

/// Errors in pixels over sigma_px: u, v and disparity; the last is 0 without a depth. Needs p_camera.z() > 0.
inline Eigen::Vector3d ReprojectionError(const PinholeCamera& camera, const ReprojectionMeasurement& measured,
                                         const Eigen::Vector3d& p_camera) {
  Eigen::Vector3d error;
  error.head<2>() = camera.Project(p_camera) - measured.pixel;
  error.z() = measured.depth_m > 0 ? measured.bf_px_m * (1.0 / p_camera.z() - 1.0 / measured.depth_m) : 0.0;
  return error / measured.sigma_px;
}

/// Derivative of ReprojectionError with respect to p_camera.
inline Eigen::Matrix3d ReprojectionByPoint(const PinholeCamera& camera, const ReprojectionMeasurement& measured,
                                           const Eigen::Vector3d& p_camera) {
  const double inverse_z = 1.0 / p_camera.z();
  const double inverse_z2 = inverse_z * inverse_z;
  Eigen::Matrix3d by_point = Eigen::Matrix3d::Zero();
  by_point(0, 0) = camera.fx * inverse_z;
  by_point(0, 2) = -camera.fx * p_camera.x() * inverse_z2;
  by_point(1, 1) = camera.fy * inverse_z;
  by_point(1, 2) = -camera.fy * p_camera.y() * inverse_z2;
  if (measured.depth_m > 0) by_point(2, 2) = -measured.bf_px_m * inverse_z2;
  return by_point / measured.sigma_px;
}

/// Derivative with respect to the right perturbation [rho; phi] of T_world_camera, by the chain rule from that with
/// respect to p_camera: p_camera(T Exp(d)) = Exp(-d) p_camera = p_camera - rho + p_camera x phi, to first order.
inline Eigen::Matrix<double, 3, 6> ByPose(const Eigen::Matrix3d& by_point_camera, const Eigen::Vector3d& p_camera) {
  Eigen::Matrix<double, 3, 6> by_pose;
  by_pose.leftCols<3>() = -by_point_camera;
  by_pose.rightCols<3>().noalias() = by_point_camera * Skew(p_camera);
  return by_pose;
}

}  // namespace mapp::internal
