#pragma once

#include "mapp/camera/camera_model.h"

#include <Eigen/Core>

namespace mapp::tracker {

/// The camera as tracking sees it: an undistorted pinhole, the region its pixels can lie in, and how far depth serves.
struct TrackingCamera {
  Camera recorded;        ///< what keyframes and poses refer to; for stereo the rectified left camera
  PinholeCamera pinhole;  ///< of undistorted pixels
  SensorKind sensor = SensorKind::kRgbd;
  Eigen::Vector2d min_px;  ///< undistorted pixels of the recorded image lie in [min_px, max_px]
  Eigen::Vector2d max_px;
  double bf_px_m = 0;      ///< focal length times (virtual) baseline: a depth z weighs as the disparity bf / z
  double max_depth_m = 0;  ///< depths beyond are not made into points at once

  bool Contains(const Eigen::Vector2d& pixel) const {
    return (pixel.array() >= min_px.array()).all() && (pixel.array() <= max_px.array()).all();
  }
};

/// `max_depth_m` 0 picks 6 m for RGB-D and 40 baselines for stereo.
TrackingCamera MakeTrackingCamera(const Camera& recorded, SensorKind sensor, double max_depth_m);

}  // namespace mapp::tracker
