#include "client_sdk/src/tracker/tracking_camera.h"

#include <algorithm>

namespace mapp::tracker {
namespace {

/// Baseline that a structured-light camera would have as a stereo pair, metres: bf = 40 px m at f = 525 px
/// (Mur-Artal and Tardos, T-RO 2017, section III-A).
constexpr double kRgbdBaselineM = 40.0 / 525.0;
/// Practical range of structured light and time-of-flight cameras.
constexpr double kRgbdMaxDepthM = 6.0;
/// Depths beyond 40 baselines are too uncertain for a point from one frame (Mur-Artal and Tardos 2017, section III-B).
constexpr double kStereoMaxBaselines = 40.0;

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
  const bool is_stereo = sensor == SensorKind::kStereo;
  const double baseline_m = is_stereo ? recorded.stereo_baseline_m : kRgbdBaselineM;
  camera.bf_px_m = camera.pinhole.fx * baseline_m;
  camera.max_depth_m = max_depth_m > 0 ? max_depth_m : is_stereo ? kStereoMaxBaselines * baseline_m : kRgbdMaxDepthM;
  return camera;
}

}  // namespace mapp::tracker
