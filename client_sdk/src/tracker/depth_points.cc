#include "client_sdk/src/tracker/depth_points.h"

#include <algorithm>
#include <utility>

namespace mapp::tracker {
namespace {

constexpr size_t kMinPoints = 100;
/// Beyond this many times the usable depth a reading says nothing: a stereo disparity is noise, a depth image is in
/// another unit than it claims.
constexpr double kFarthestShare = 3;

}  // namespace

bool HasUsableDepth(const Frame& frame, size_t feature, const TrackingCamera& camera) {
  const auto depth_m = static_cast<double>(frame.depths_m[feature]);
  return depth_m >= camera.min_point_depth_m && depth_m <= camera.max_depth_m;
}

std::vector<size_t> FeaturesForPoints(const Frame& frame, const TrackingCamera& camera) {
  std::vector<size_t> chosen, far;
  for (size_t feature = 0; feature < frame.size(); ++feature) {
    if (HasUsableDepth(frame, feature, camera)) {
      chosen.push_back(feature);
      continue;
    }
    const auto depth_m = static_cast<double>(frame.depths_m[feature]);
    if (depth_m >= camera.min_point_depth_m && depth_m <= kFarthestShare * camera.max_depth_m) far.push_back(feature);
  }
  if (chosen.size() >= kMinPoints || far.empty()) return chosen;
  const size_t num_added = std::min(kMinPoints - chosen.size(), far.size());
  std::partial_sort(
      far.begin(), far.begin() + static_cast<std::ptrdiff_t>(num_added), far.end(),
      [&](size_t a, size_t b) { return std::pair(frame.depths_m[a], a) < std::pair(frame.depths_m[b], b); });
  chosen.insert(chosen.end(), far.begin(), far.begin() + static_cast<std::ptrdiff_t>(num_added));
  std::sort(chosen.begin(), chosen.end());
  return chosen;
}

Eigen::Vector3d DepthPoint(const Frame& frame, size_t feature, const TrackingCamera& camera,
                           const Pose3& T_session_camera) {
  const Eigen::Vector3d p_camera =
      static_cast<double>(frame.depths_m[feature]) * camera.pinhole.Unproject(frame.pixels[feature]);
  return T_session_camera * p_camera;
}

std::vector<PointView> DepthPointViews(const Frame& frame, const TrackingCamera& camera, const Pose3& T_session_camera,
                                       std::span<const int> points) {
  std::vector<PointView> views;
  for (const size_t feature : FeaturesForPoints(frame, camera)) {
    if (!points.empty() && points[feature] != kNone) continue;
    PointView view;
    view.p_session = DepthPoint(frame, feature, camera, T_session_camera);
    const Eigen::Vector3d ray = view.p_session - T_session_camera.translation();
    view.view_direction = ray.normalized().cast<float>();
    view.reference_distance_m = static_cast<float>(ray.norm()) * OctaveScale(frame.features[feature].keypoint.octave);
    view.descriptor = frame.features[feature].descriptor;
    views.push_back(view);
  }
  return views;
}

}  // namespace mapp::tracker
