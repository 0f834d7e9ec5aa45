#include "client_sdk/src/tracker/session_map.h"

#include "mapp/base/check.h"

#include <Eigen/Geometry>

#include <algorithm>

namespace mapp::tracker {

int SessionMap::NewPointSlot() {
  if (free_slots_.empty()) {
    points_.emplace_back();
    return static_cast<int>(points_.size()) - 1;
  }
  const int slot = free_slots_.back();
  free_slots_.pop_back();
  points_[static_cast<size_t>(slot)] = MapPoint();
  return slot;
}

int SessionMap::AddKeyframe(std::shared_ptr<const Frame> frame, const Pose3& T_session_camera,
                            const std::vector<int>& points, int generation) {
  MAPP_CHECK(points.size() == frame->size());
  const int keyframe_idx = num_keyframes();
  const size_t num_features = frame->size();
  keyframes_.push_back({std::move(frame), T_session_camera, std::vector<int>(num_features, kNone), generation});
  for (size_t feature = 0; feature < num_features; ++feature) {
    const int point_idx = points[feature] == kNone ? kNone : Resolve(points[feature]);
    if (point_idx == kNone) continue;
    if (AddObservation(point_idx, keyframe_idx, static_cast<int>(feature))) UpdateView(point_idx);
  }
  return keyframe_idx;
}

int SessionMap::AddPoint(const Eigen::Vector3d& p_session, int keyframe_idx, int feature_idx) {
  const int point_idx = NewPointSlot();
  MapPoint& added = mutable_point(point_idx);
  added.view.point_idx = point_idx;
  added.view.p_session = p_session;
  added.session_id = ReserveSessionIds(1);
  added.generation = keyframe(keyframe_idx).generation;
  added.first_keyframe_idx = keyframe_idx;
  MAPP_CHECK(AddObservation(point_idx, keyframe_idx, feature_idx));
  UpdateView(point_idx);
  return point_idx;
}

int SessionMap::AddSharedPoint(PointView view, MapPointId server_id, int generation) {
  const int point_idx = NewPointSlot();
  MapPoint& added = mutable_point(point_idx);
  view.point_idx = point_idx;
  view.from_server = true;
  added.view = view;
  added.server_id = server_id;
  added.generation = generation;
  return point_idx;
}

bool SessionMap::AddObservation(int point_idx, int keyframe_idx, int feature_idx) {
  int& slot = keyframes_[static_cast<size_t>(keyframe_idx)].points[static_cast<size_t>(feature_idx)];
  if (slot != kNone) return false;
  std::vector<PointObservation>& observations = mutable_point(point_idx).observations;
  const bool observes = std::any_of(observations.begin(), observations.end(), [keyframe_idx](const auto& observation) {
    return observation.keyframe_idx == keyframe_idx;
  });
  if (observes) return false;
  observations.push_back({keyframe_idx, feature_idx});
  slot = point_idx;
  return true;
}

void SessionMap::RemoveObservation(int point_idx, int keyframe_idx) {
  MapPoint& observed = mutable_point(point_idx);
  const auto found = std::find_if(observed.observations.begin(), observed.observations.end(),
                                  [keyframe_idx](const auto& o) { return o.keyframe_idx == keyframe_idx; });
  if (found == observed.observations.end()) return;
  keyframes_[static_cast<size_t>(keyframe_idx)].points[static_cast<size_t>(found->feature_idx)] = kNone;
  observed.observations.erase(found);
  if (observed.observations.empty() && !observed.server_id) {
    observed.removed = true;
  } else {
    UpdateView(point_idx);
  }
}

void SessionMap::RemovePoint(int point_idx) {
  MapPoint& removed = mutable_point(point_idx);
  for (const PointObservation& observation : removed.observations) {
    keyframes_[static_cast<size_t>(observation.keyframe_idx)].points[static_cast<size_t>(observation.feature_idx)] =
        kNone;
  }
  removed.observations.clear();
  removed.removed = true;
}

void SessionMap::ReplacePoint(int drop_idx, int keep_idx) {
  MAPP_CHECK(drop_idx != keep_idx);
  const std::vector<PointObservation> moved = point(drop_idx).observations;
  MapPoint& keep = mutable_point(keep_idx);
  keep.num_visible += point(drop_idx).num_visible;
  keep.num_found += point(drop_idx).num_found;
  RemovePoint(drop_idx);
  mutable_point(drop_idx).replaced_by = keep_idx;
  for (const PointObservation& observation : moved) {
    AddObservation(keep_idx, observation.keyframe_idx, observation.feature_idx);
  }
  UpdateView(keep_idx);
}

void SessionMap::UpdateView(int point_idx) {
  MapPoint& updated = mutable_point(point_idx);
  if (updated.server_id || updated.observations.empty()) return;
  std::vector<OrbDescriptor> descriptors;
  Eigen::Vector3d direction_sum = Eigen::Vector3d::Zero();
  double reference_sum_m = 0;
  for (const PointObservation& observation : updated.observations) {
    const MapKeyframe& observer = keyframe(observation.keyframe_idx);
    const Feature& feature = observer.frame->features[static_cast<size_t>(observation.feature_idx)];
    descriptors.push_back(feature.descriptor);
    const Eigen::Vector3d ray = updated.view.p_session - observer.T_session_camera.translation();
    direction_sum += ray.normalized();
    reference_sum_m += ray.norm() * static_cast<double>(OctaveScale(feature.keypoint.octave));
  }
  updated.view.descriptor = descriptors[RepresentativeDescriptor(descriptors)];
  updated.view.view_direction = direction_sum.normalized().cast<float>();
  updated.view.reference_distance_m =
      static_cast<float>(reference_sum_m / static_cast<double>(updated.observations.size()));
}

void SessionMap::RetireGeneration(int generation) {
  for (MapKeyframe& retired : keyframes_) {
    if (retired.generation != generation) continue;
    retired.frame.reset();
    retired.points.clear();
  }
  for (size_t slot = 0; slot < points_.size(); ++slot) {
    MapPoint& retired = points_[slot];
    if (retired.generation != generation) continue;
    retired = MapPoint();
    retired.removed = true;
    retired.generation = kNone;
    free_slots_.push_back(static_cast<int>(slot));
  }
}

uint64_t SessionMap::ReserveSessionIds(size_t count) {
  const uint64_t first = next_session_id_;
  next_session_id_ += count;
  return first;
}

int SessionMap::Resolve(int point_idx) const {
  while (point_idx != kNone && point(point_idx).removed) point_idx = point(point_idx).replaced_by;
  return point_idx;
}

void SessionMap::SetKeyframePose(int keyframe_idx, const Pose3& T_session_camera) {
  keyframes_[static_cast<size_t>(keyframe_idx)].T_session_camera = T_session_camera;
}

void SessionMap::SetPointPosition(int point_idx, const Eigen::Vector3d& p_session) {
  mutable_point(point_idx).view.p_session = p_session;
}

double SessionMap::MedianDepth(std::span<const int> points, const Pose3& T_session_camera) const {
  const Pose3 T_camera_session = T_session_camera.Inverse();
  std::vector<double> depths;
  for (const int tracked_idx : points) {
    const int point_idx = tracked_idx == kNone ? kNone : Resolve(tracked_idx);
    if (point_idx != kNone) depths.push_back((T_camera_session * point(point_idx).view.p_session).z());
  }
  if (depths.empty()) return 1;
  const auto middle = depths.begin() + static_cast<std::ptrdiff_t>(depths.size() / 2);
  std::nth_element(depths.begin(), middle, depths.end());
  return *middle;
}

double SessionMap::MedianDepth(int keyframe_idx) const {
  return MedianDepth(keyframe(keyframe_idx).points, keyframe(keyframe_idx).T_session_camera);
}

std::vector<std::pair<int, int>> SessionMap::CovisibleKeyframes(int keyframe_idx, int min_shared) const {
  std::vector<int> num_shared(keyframes_.size(), 0);
  for (const int point_idx : keyframe(keyframe_idx).points) {
    if (point_idx == kNone) continue;
    for (const PointObservation& observation : point(point_idx).observations) {
      ++num_shared[static_cast<size_t>(observation.keyframe_idx)];
    }
  }
  num_shared[static_cast<size_t>(keyframe_idx)] = 0;
  std::vector<std::pair<int, int>> covisible;
  for (int other_idx = 0; other_idx < num_keyframes(); ++other_idx) {
    const int count = num_shared[static_cast<size_t>(other_idx)];
    if (count >= min_shared) covisible.emplace_back(other_idx, count);
  }
  std::stable_sort(covisible.begin(), covisible.end(),
                   [](const auto& a, const auto& b) { return a.second > b.second; });
  return covisible;
}

std::vector<int> SessionMap::KeyframesNear(const Pose3& T_session_camera, double max_distance_m, double max_angle,
                                           int generation) const {
  std::vector<std::pair<double, int>> found;
  for (int idx = 0; idx < num_keyframes(); ++idx) {
    const MapKeyframe& candidate = keyframe(idx);
    if (candidate.generation != generation || candidate.frame == nullptr) continue;
    const double distance_m = Distance(candidate.T_session_camera, T_session_camera);
    if (distance_m > max_distance_m || RotationAngle(candidate.T_session_camera, T_session_camera) > max_angle) {
      continue;
    }
    found.emplace_back(distance_m, idx);
  }
  std::sort(found.begin(), found.end());
  std::vector<int> near;
  near.reserve(found.size());
  for (const auto& [distance_m, idx] : found) near.push_back(idx);
  return near;
}

}  // namespace mapp::tracker
