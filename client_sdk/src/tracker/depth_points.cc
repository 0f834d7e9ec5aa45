#include "client_sdk/src/tracker/depth_points.h"

namespace mapp::tracker {

bool HasUsableDepth(const Frame& frame, size_t feature, const TrackingCamera& camera) {
  const auto depth_m = static_cast<double>(frame.depths_m[feature]);
  return depth_m >= kMinPointDepthM && depth_m <= camera.max_depth_m;
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
  for (size_t feature = 0; feature < frame.size(); ++feature) {
    if (!points.empty() && points[feature] != kNone) continue;
    if (!HasUsableDepth(frame, feature, camera)) continue;
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
