#pragma once

#include "mapp/camera/camera_model.h"

#include <Eigen/Core>

namespace mapp::tracker {

/// Points nearer than this to the camera's plane, or behind it, are of no use.
inline constexpr double kMinPointDepthM = 0.05;

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

  bool Contains(const Eigen::Vector2d& pixel) const {
    return (pixel.array() >= min_px.array()).all() && (pixel.array() <= max_px.array()).all();
  }
};

/// `max_depth_m` 0 picks 6 m for RGB-D and 40 baselines for stereo.
TrackingCamera MakeTrackingCamera(const Camera& recorded, SensorKind sensor, double max_depth_m);

}  // namespace mapp::tracker
