#pragma once

#include "mapp/camera/camera_model.h"

#include <Eigen/Core>

namespace mapp::tracker {

/// Points nearer than this to the camera's plane, or behind it, are of no use.
inline constexpr double kMinPointDepthM = 0.05;
/// A camera without scale has nothing to say how near is too near, only what is at the plane itself.
inline constexpr double kMinPointDepthMono = 1e-3;

/// How far measured depths are trusted against the points of a map.
struct DepthTrust {
  double bf_px_m = 0;   ///< a depth z weighs as the disparity bf / z with sigma 1 px: sigma_z = z^2 / bf
  double chi2 = 7.815;  ///< bound on pixel and depth together, 3 degrees of freedom
  bool applies_to_server_points = true;  ///< false: points of a shared map are held by their pixels alone
};

/// The camera as tracking sees it: an undistorted pinhole, the region its pixels can lie in, and how far depth serves.
struct TrackingCamera {
  Camera recorded;        ///< what keyframes and poses refer to; for stereo the rectified left camera
  PinholeCamera pinhole;  ///< of undistorted pixels
  SensorKind sensor = SensorKind::kRgbd;
  Eigen::Vector2d min_px;  ///< undistorted pixels of the recorded image lie in [min_px, max_px]
  Eigen::Vector2d max_px;
  DepthTrust own_map;      ///< against points that this device measured
  DepthTrust shared_map;   ///< against a server's, which other devices measured, aligned within its limits
  double max_depth_m = 0;  ///< depths beyond are not made into points at once
  double min_point_depth_m = kMinPointDepthM;  ///< mono: in session units

  /// Whether lengths are metres. A single camera does not tell them: its sessions have a unit of their own, in which
  /// the median depth of the first view is 1.
  bool metric() const { return sensor != SensorKind::kMono; }
  /// What stands for a metre where the points in view are `median_depth` away (session units): 1 for metric sensors.
  /// For mono the thresholds that are lengths shrink and grow with the scene.
  double MetreAt(double median_depth) const;

  bool Contains(const Eigen::Vector2d& pixel) const {
    return (pixel.array() >= min_px.array()).all() && (pixel.array() <= max_px.array()).all();
  }
};

/// `max_depth_m` 0 picks 6 m for RGB-D and 40 baselines for stereo; mono measures none.
TrackingCamera MakeTrackingCamera(const Camera& recorded, SensorKind sensor, double max_depth_m);

}  // namespace mapp::tracker
