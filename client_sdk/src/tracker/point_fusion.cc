#include "client_sdk/src/tracker/point_fusion.h"

#include "client_sdk/src/tracker/local_window.h"
#include "client_sdk/src/tracker/point_search.h"

#include <algorithm>
#include <unordered_set>

namespace mapp::tracker {
namespace {

/// A feature's own point is the same as the projected one only when they lie this near each other, as a share of the
/// distance from the camera: twice the depth noise of structured light at 3 m.
constexpr double kMaxRelativeGap = 0.04;

struct TargetCopy {
  std::shared_ptr<const Frame> frame;
  Pose3 T_session_camera;
};

/// Applies one match of a point to a feature of the target keyframe.
void ApplyMatch(SessionMap& map, int matched_idx, int target_idx, int feature_idx) {
  const int point_idx = map.Resolve(matched_idx);
  if (point_idx == kNone) return;
  const MapKeyframe& target = map.keyframe(target_idx);
  const int present_idx = target.points[static_cast<size_t>(feature_idx)];
  if (present_idx == kNone) {
    if (map.AddObservation(point_idx, target_idx, feature_idx)) map.UpdateView(point_idx);
    return;
  }
  if (present_idx == point_idx) return;
  const MapPoint& present = map.point(present_idx);
  const MapPoint& matched = map.point(point_idx);
  if (present.server_id && matched.server_id) return;
  const double distance_m = (matched.view.p_session - target.T_session_camera.translation()).norm();
  if ((matched.view.p_session - present.view.p_session).norm() > kMaxRelativeGap * distance_m) return;
  const bool keep_present = present.server_id.has_value() ||
                            (!matched.server_id && present.observations.size() >= matched.observations.size());
  if (keep_present) {
    map.ReplacePoint(point_idx, present_idx);
  } else {
    map.ReplacePoint(present_idx, point_idx);
  }
}

void FuseInto(SharedSessionMap& shared, const TrackingCamera& camera, const std::vector<PointView>& points,
              int target_idx) {
  TargetCopy target;
  std::vector<PointView> unseen;
  {
    MutexLock lock(shared.mutex);
    const MapKeyframe& keyframe = shared.map.keyframe(target_idx);
    target = {keyframe.frame, keyframe.T_session_camera};
    const std::unordered_set<int> observed(keyframe.points.begin(), keyframe.points.end());
    for (const PointView& point : points) {
      if (!observed.contains(point.point_idx)) unseen.push_back(point);
    }
  }
  SearchOptions options;
  options.radius_px = 3.0;
  options.max_distance = 50;
  options.max_ratio = 1.0;
  const SearchResult found = SearchByProjection(*target.frame, camera, target.T_session_camera, unseen, options);
  MutexLock lock(shared.mutex);
  for (const Match& match : found.matches) {
    const PointView& point = unseen[static_cast<size_t>(match.query_idx)];
    const auto feature = static_cast<size_t>(match.train_idx);
    // With a depth at the feature the two must agree on it as well.
    const double z_m =
        (target.T_session_camera.rotation().conjugate() * (point.p_session - target.T_session_camera.translation()))
            .z();
    const auto measured_m = static_cast<double>(target.frame->depths_m[feature]);
    if (measured_m > 0 && std::abs(measured_m - z_m) > kMaxRelativeGap * z_m) continue;
    ApplyMatch(shared.map, point.point_idx, target_idx, match.train_idx);
  }
}

}  // namespace

std::vector<int> FusionNeighbors(const SessionMap& map, const TrackingCamera& camera, int keyframe_idx,
                                 size_t max_neighbors) {
  std::vector<int> neighbors;
  for (const auto& [other_idx, num_shared] : map.CovisibleKeyframes(keyframe_idx, kMinSharedPoints)) {
    if (neighbors.size() < max_neighbors) neighbors.push_back(other_idx);
  }
  const MapKeyframe& keyframe = map.keyframe(keyframe_idx);
  const double near_distance_m = kNearDistanceM * camera.MetreAt(map.MedianDepth(keyframe_idx));
  size_t num_near = 0;
  for (const int near_idx :
       map.KeyframesNear(keyframe.T_session_camera, near_distance_m, kNearAngle, keyframe.generation)) {
    if (near_idx == keyframe_idx || std::find(neighbors.begin(), neighbors.end(), near_idx) != neighbors.end()) {
      continue;
    }
    if (num_near++ == max_neighbors / 2) break;
    neighbors.push_back(near_idx);
  }
  return neighbors;
}

void FuseWithNeighbors(SharedSessionMap& shared, const TrackingCamera& camera, int keyframe_idx,
                       const std::vector<int>& neighbors) {
  std::vector<PointView> own_points;
  {
    MutexLock lock(shared.mutex);
    own_points = CopyPoints(shared.map, shared.map.keyframe(keyframe_idx).points);
  }
  for (const int neighbor_idx : neighbors) FuseInto(shared, camera, own_points, neighbor_idx);

  std::vector<PointView> neighbor_points;
  {
    MutexLock lock(shared.mutex);
    std::unordered_set<int> known;
    for (const int neighbor_idx : neighbors) {
      for (const int point_idx : shared.map.keyframe(neighbor_idx).points) {
        if (point_idx == kNone || !known.insert(point_idx).second) continue;
        neighbor_points.push_back(shared.map.point(point_idx).view);
      }
    }
  }
  FuseInto(shared, camera, neighbor_points, keyframe_idx);
}

}  // namespace mapp::tracker
