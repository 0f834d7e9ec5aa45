#include "client_sdk/src/tracker/keyframe_export.h"

#include "client_sdk/src/tracker/depth_points.h"

#include <algorithm>
#include <limits>

namespace mapp::tracker {
namespace {

/// How far a raster reaches, in usable depths. There a stereo disparity is off by 7 % (sigma 0.5 px), as much again
/// being what tells places apart (SightingOptions::match_radius).
constexpr double kRasterShare = 2;

std::optional<PointReference> MakeReference(const MapPoint& point, const Pose3& T_camera_session, double min_depth_m) {
  const double z_m = (T_camera_session * point.view.p_session).z();
  // Triangulated almost in parallel, a point may come out anywhere; the service would refuse the keyframe for it.
  if (!(z_m > min_depth_m && static_cast<float>(z_m) < kMaxPointDepthM)) return std::nullopt;
  PointReference reference;
  reference.kind = point.server_id ? PointReference::Kind::kMapPoint : PointReference::Kind::kSessionPoint;
  reference.id = point.server_id ? point.server_id->value() : point.session_id;
  reference.depth_m = static_cast<float>(z_m);
  constexpr size_t kMost = std::numeric_limits<uint16_t>::max();
  reference.num_observations = static_cast<uint16_t>(std::clamp<size_t>(point.observations.size(), 1, kMost));
  return reference;
}

Keyframe MakeKeyframe(const SessionMap& map, const TrackingCamera& camera, const Frame& frame,
                      const Pose3& T_session_camera, const std::vector<int>& points) {
  Keyframe keyframe;
  keyframe.stamp_ns = frame.stamp_ns;
  keyframe.T_frame_camera = T_session_camera;
  keyframe.features.reserve(frame.size());
  const Pose3 T_camera_session = T_session_camera.Inverse();
  DepthRasterizer rasterizer(camera.recorded);
  const double farthest_m = kRasterShare * camera.max_depth_m;
  for (size_t feature = 0; feature < frame.size(); ++feature) {
    keyframe.features.push_back({frame.features[feature].keypoint, frame.features[feature].descriptor, std::nullopt});
    const int point_idx = points[feature] == kNone ? kNone : map.Resolve(points[feature]);
    if (point_idx != kNone)
      keyframe.features.back().point = MakeReference(map.point(point_idx), T_camera_session, camera.min_point_depth_m);
    const std::optional<PointReference>& point = keyframe.features.back().point;
    const float depth_m = point ? point->depth_m : frame.depths_m[feature] <= farthest_m ? frame.depths_m[feature] : 0;
    const Keypoint& keypoint = keyframe.features.back().keypoint;
    rasterizer.Add({keypoint.u_px, keypoint.v_px}, depth_m);
  }
  keyframe.raster = rasterizer.Finish();
  return keyframe;
}

}  // namespace

Keyframe ExportKeyframe(const SessionMap& map, const TrackingCamera& camera, int keyframe_idx) {
  const MapKeyframe& keyframe = map.keyframe(keyframe_idx);
  return MakeKeyframe(map, camera, *keyframe.frame, keyframe.T_session_camera, keyframe.points);
}

Keyframe ExportFrame(SessionMap& map, const TrackingCamera& camera, const Frame& frame, const Pose3& T_session_camera,
                     const std::vector<int>& points) {
  Keyframe keyframe = MakeKeyframe(map, camera, frame, T_session_camera, points);
  for (size_t feature = 0; feature < frame.size(); ++feature) {
    if (keyframe.features[feature].point || !HasUsableDepth(frame, feature, camera)) continue;
    PointReference reference;
    reference.id = map.ReserveSessionIds(1);
    reference.depth_m = frame.depths_m[feature];
    keyframe.features[feature].point = reference;
  }
  return keyframe;
}

}  // namespace mapp::tracker
