#include "sim_device/landmark_points.h"

#include "client_sdk/src/tracker/depth_points.h"

#include <algorithm>
#include <utility>

namespace mapp::sim {
namespace {

/// Greatest descriptor distance and pixel error (of the octave) at which a feature is taken for a point.
constexpr int kMaxDistance = 80;
constexpr double kMaxError_px = 5;
/// A landmark not seen for so many keyframes is a new point when it comes back.
constexpr int kMaxKeyframesUnseen = 20;

/// Weight of a position measured at depth z, as the camera trusts depths: sigma_z = z^2 / bf.
double WeightOf(double z_m, double bf_px_m) {
  const double sigma_m = z_m * z_m / bf_px_m;
  return 1.0 / (sigma_m * sigma_m);
}

}  // namespace

LandmarkPoints::Track* LandmarkPoints::FindTrack(const tracker::Frame& frame, size_t feature, uint64_t landmark,
                                                 const Pose3& T_camera_session) {
  const auto found = tracks_.find(landmark);
  if (found == tracks_.end()) return nullptr;
  Track& track = found->second;
  shared_.mutex.Lock();
  const tracker::MapPoint point = shared_.map.point(track.point_idx);
  const int next_keyframe_idx = shared_.map.num_keyframes();
  shared_.mutex.Unlock();
  if (point.removed || next_keyframe_idx - track.last_keyframe_idx > kMaxKeyframesUnseen) return nullptr;
  const Eigen::Vector3d p_camera = T_camera_session * point.view.p_session;
  if (p_camera.z() < tracker::kMinPointDepthM) return nullptr;
  const Keypoint& keypoint = frame.features[feature].keypoint;
  const double error_px = (camera_.pinhole.Project(p_camera) - frame.pixels[feature]).norm();
  if (error_px > kMaxError_px * static_cast<double>(OctaveScale(keypoint.octave))) return nullptr;
  if (HammingDistance(track.descriptor, frame.features[feature].descriptor) > kMaxDistance) return nullptr;
  return &track;
}

void LandmarkPoints::Improve(const tracker::Frame& frame, size_t feature, const Pose3& T_session_camera, Track& track) {
  if (!tracker::HasUsableDepth(frame, feature, camera_)) return;
  const double weight = WeightOf(static_cast<double>(frame.depths_m[feature]), camera_.own_map.bf_px_m);
  const Eigen::Vector3d measured_session = tracker::DepthPoint(frame, feature, camera_, T_session_camera);
  MutexLock lock(shared_.mutex);
  const Eigen::Vector3d& p_session = shared_.map.point(track.point_idx).view.p_session;
  track.weight += weight;
  shared_.map.SetPointPosition(track.point_idx, p_session + weight / track.weight * (measured_session - p_session));
}

int LandmarkPoints::AddKeyframe(const std::shared_ptr<const tracker::Frame>& frame, std::span<const uint64_t> landmarks,
                                const Pose3& T_session_camera, std::vector<int> points, int generation) {
  const Pose3 T_camera_session = T_session_camera.Inverse();
  for (size_t feature = 0; feature < frame->size(); ++feature) {
    if (landmarks[feature] == 0 || points[feature] != tracker::kNone) continue;
    Track* track = FindTrack(*frame, feature, landmarks[feature], T_camera_session);
    if (track == nullptr) continue;
    Improve(*frame, feature, T_session_camera, *track);
    points[feature] = track->point_idx;
  }
  MutexLock lock(shared_.mutex);
  tracker::SessionMap& map = shared_.map;
  const int keyframe_idx = map.AddKeyframe(frame, T_session_camera, points, generation);
  std::vector<bool> makes_point(frame->size(), false);
  for (const size_t feature : tracker::FeaturesForPoints(*frame, camera_)) makes_point[feature] = true;
  for (size_t feature = 0; feature < frame->size(); ++feature) {
    int point_idx = points[feature];
    const bool is_new = point_idx == tracker::kNone;
    if (is_new) {
      if (!makes_point[feature]) continue;
      point_idx = map.AddPoint(tracker::DepthPoint(*frame, feature, camera_, T_session_camera), keyframe_idx,
                               static_cast<int>(feature));
    }
    if (landmarks[feature] == 0 || map.point(point_idx).server_id) continue;
    Track& track = tracks_[landmarks[feature]];
    if (is_new) track.weight = WeightOf(static_cast<double>(frame->depths_m[feature]), camera_.own_map.bf_px_m);
    track.point_idx = point_idx;
    track.descriptor = frame->features[feature].descriptor;
    track.last_keyframe_idx = keyframe_idx;
  }
  std::erase_if(tracks_,
                [&](const auto& entry) { return keyframe_idx - entry.second.last_keyframe_idx > kMaxKeyframesUnseen; });
  return keyframe_idx;
}

}  // namespace mapp::sim
