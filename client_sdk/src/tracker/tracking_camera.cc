#include "client_sdk/src/tracker/tracking_camera.h"

#include <algorithm>

namespace mapp::tracker {
namespace {

/// Random error of structured light: sigma_z = 0.0016 z^2, z in metres. Source: 0.00143 for the Kinect (Khoshelham and
/// Elberink, Sensors 2012), rounded up for readings at corners. Against bf = 40 px m, common for such cameras since
/// Mur-Artal and Tardos (T-RO 2017), which stands for 0.025 z^2, the trajectory error in recorded rooms falls by a
/// third.
constexpr double kRgbdOwnBf = 1.0 / 0.0016;
/// The tails are heavier than the noise: readings near depth steps. Measured best between 7.8 and 20.
constexpr double kRgbdOwnChi2 = 12.0;
/// A shared map is bent by the errors of all who made it, a few centimetres at a few metres.
constexpr double kRgbdSharedBf = 40.0;
/// Practical range of structured light and time-of-flight cameras.
constexpr double kRgbdMaxDepthM = 6.0;
/// Depths beyond 40 baselines are too uncertain for a point from one frame (Mur-Artal and Tardos 2017, section III-B).
constexpr double kStereoMaxBaselines = 40.0;
/// Median depth of the scenes that the thresholds in metres were chosen in: rooms, aisles, halls.
constexpr double kTypicalDepthM = 3.0;

}  // namespace

TrackingCamera MakeTrackingCamera(const Camera& recorded, SensorKind sensor, double max_depth_m) {
  TrackingCamera camera;
  camera.recorded = recorded;
  camera.pinhole = recorded.Undistorted();
  camera.sensor = sensor;
  const double width = recorded.width_px, height = recorded.height_px;
  // The extremes of an undistorted image lie at its corners or, with barrel distortion, at the middle of its edges.
  const Eigen::Vector2d border[] = {
      {0, 0},      {width / 2, 0},      {width, 0},     {0, height / 2}, {width, height / 2},
      {0, height}, {width / 2, height}, {width, height}};
  camera.min_px.setConstant(1e9);
  camera.max_px.setConstant(-1e9);
  for (const Eigen::Vector2d& pixel : border) {
    const Eigen::Vector2d undistorted = camera.pinhole.Project(recorded.Unproject(pixel));
    camera.min_px = camera.min_px.cwiseMin(undistorted);
    camera.max_px = camera.max_px.cwiseMax(undistorted);
  }
  if (sensor == SensorKind::kStereo) {
    const double baseline_m = recorded.stereo_baseline_m;
    camera.own_map.bf_px_m = camera.shared_map.bf_px_m = camera.pinhole.fx * baseline_m;
    camera.max_depth_m = kStereoMaxBaselines * baseline_m;
  } else if (sensor == SensorKind::kMono) {
    camera.min_point_depth_m = kMinPointDepthMono;
  } else {
    camera.own_map.bf_px_m = kRgbdOwnBf;
    camera.own_map.chi2 = kRgbdOwnChi2;
    camera.shared_map.bf_px_m = kRgbdSharedBf;
    camera.max_depth_m = kRgbdMaxDepthM;
  }
  camera.own_map.applies_to_server_points = false;
  if (max_depth_m > 0) camera.max_depth_m = max_depth_m;
  return camera;
}

double TrackingCamera::MetreAt(double median_depth) const { return metric() ? 1.0 : median_depth / kTypicalDepthM; }

}  // namespace mapp::tracker
