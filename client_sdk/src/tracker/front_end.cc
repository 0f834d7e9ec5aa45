#include "client_sdk/src/tracker/front_end.h"

#include "client_sdk/src/tracker/depth_points.h"
#include "client_sdk/src/tracker/local_window.h"

#include <algorithm>
#include <utility>

namespace mapp::tracker {
namespace {

/// Half the search window around a predicted pose: the prediction is off by what a hand changes in 1/15 s.
constexpr double kPredictedRadiusPx = 12.0;
/// ... and around a pose that the last frame's points have refined.
constexpr double kRefinedRadiusPx = 5.0;
/// With this share of the last frame's points found again, the prediction was right.
constexpr double kSureShare = 0.3;
/// Nobody moves evenly for longer.
constexpr double kMaxPredictedS = 0.5;

double SecondsBetween(const Frame& earlier, const Frame& later) {
  return 1e-9 * static_cast<double>(later.stamp_ns - earlier.stamp_ns);
}

}  // namespace

void FrontEnd::Refresh() {
  if (!last_ || last_->reference_keyframe_idx == kNone) return;
  MutexLock lock(shared_.mutex);
  last_->T_session_camera =
      shared_.map.keyframe(last_->reference_keyframe_idx).T_session_camera * last_->T_reference_camera;
}

std::vector<PointView> FrontEnd::PointsOfLastFrame() const {
  std::vector<PointView> points;
  {
    MutexLock lock(shared_.mutex);
    points = CopyPoints(shared_.map, last_->points);
  }
  // Features without a map point serve as points of the moment: they help to find the next pose when little of the map
  // is in view, and are forgotten then.
  const std::vector<PointView> depth_points =
      DepthPointViews(*last_->frame, camera_, last_->T_session_camera, last_->points);
  points.insert(points.end(), depth_points.begin(), depth_points.end());
  return points;
}

std::vector<PointView> FrontEnd::PointsOfReferenceKeyframe() const {
  if (last_->reference_keyframe_idx == kNone) return {};
  MutexLock lock(shared_.mutex);
  return CopyPoints(shared_.map, shared_.map.keyframe(last_->reference_keyframe_idx).points);
}

Pose3 FrontEnd::Predict(const Frame& frame) const {
  const double elapsed_s = SecondsBetween(*last_->frame, frame);
  return last_->T_session_camera * Pose3::Exp(std::min(elapsed_s, kMaxPredictedS) * velocity_);
}

std::optional<PoseEstimate> FrontEnd::TrackFromLast(const Frame& frame) const {
  if (!last_) return std::nullopt;
  const std::vector<PointView> points = PointsOfLastFrame();
  SearchOptions options;
  options.radius_px = kPredictedRadiusPx;
  PoseEstimate estimate =
      SearchAndRefine(frame, camera_, camera_.own_map, Predict(frame), points, options, options_.min_tracked_points);
  const auto sure = static_cast<int>(kSureShare * static_cast<double>(std::min(points.size(), frame.size())));
  if (estimate.num_inliers >= std::max(options_.min_tracked_points, sure)) return estimate;

  // The camera has moved otherwise than predicted. Where textures repeat, points enough fit a pose beside the true one;
  // looks alone find that in the whole image.
  const PoseBound bound =
      PoseBound::SinceLost(last_->T_session_camera, SecondsBetween(*last_->frame, frame), last_->metre);
  std::optional<PoseEstimate> found = relocalizer_.FindAmongPoints(frame, camera_.own_map, points, bound);
  if (!found) found = relocalizer_.FindAmongPoints(frame, camera_.own_map, PointsOfReferenceKeyframe(), bound);
  if (found && found->num_inliers > estimate.num_inliers) return found;
  if (estimate.num_inliers < options_.min_tracked_points) return std::nullopt;
  return estimate;
}

std::optional<TrackedFrame> FrontEnd::TrackLocalWindow(const std::shared_ptr<const Frame>& frame,
                                                       const PoseEstimate& estimate,
                                                       std::span<const PointView> known_points, int generation) {
  LocalWindow window;
  double metre = 1;
  {
    MutexLock lock(shared_.mutex);
    metre = camera_.MetreAt(shared_.map.MedianDepth(estimate.points, estimate.T_session_camera));
    window = GatherLocalWindow(shared_.map, estimate.points, estimate.T_session_camera, metre, generation);
  }
  // Shared points that keyframes observe are in the window already.
  std::vector<PointView> points = std::move(window.points);
  points.insert(points.end(), known_points.begin(), known_points.end());

  SearchOptions options;
  options.radius_px = kRefinedRadiusPx;
  const SearchResult found = SearchByProjection(*frame, camera_, estimate.T_session_camera, points, options);
  PoseEstimate refined = RefinePose(*frame, camera_, camera_.own_map, estimate.T_session_camera, points, found.matches);
  if (refined.num_inliers < options_.min_tracked_points) return std::nullopt;

  TrackedFrame tracked;
  tracked.frame = frame;
  tracked.T_session_camera = refined.T_session_camera;
  tracked.points = std::move(refined.points);
  tracked.metre = metre;
  tracked.reference_keyframe_idx = window.reference_keyframe_idx;
  MutexLock lock(shared_.mutex);
  SessionMap& map = shared_.map;
  for (const int visible : found.visible) {
    const int point_idx = map.Resolve(points[static_cast<size_t>(visible)].point_idx);
    if (point_idx != kNone) ++map.mutable_point(point_idx).num_visible;
  }
  for (const int inlier : tracked.points) {
    const int point_idx = inlier == kNone ? kNone : map.Resolve(inlier);
    if (point_idx != kNone) ++map.mutable_point(point_idx).num_found;
  }
  if (tracked.reference_keyframe_idx != kNone) {
    tracked.T_reference_camera =
        map.keyframe(tracked.reference_keyframe_idx).T_session_camera.Inverse() * tracked.T_session_camera;
  }
  return tracked;
}

void FrontEnd::SetLast(TrackedFrame tracked, bool consecutive) {
  velocity_.setZero();
  if (consecutive && last_) {
    const Pose3 T_previous_last = last_->T_session_camera.Inverse() * tracked.T_session_camera;
    const double elapsed_s = SecondsBetween(*last_->frame, *tracked.frame);
    if (elapsed_s > 0) velocity_ = T_previous_last.Log() / elapsed_s;
  }
  last_ = std::move(tracked);
}

void FrontEnd::SetLastKeyframe(int keyframe_idx, std::vector<int> points) {
  last_->reference_keyframe_idx = keyframe_idx;
  last_->T_reference_camera = Pose3();
  last_->points = std::move(points);
}

}  // namespace mapp::tracker
