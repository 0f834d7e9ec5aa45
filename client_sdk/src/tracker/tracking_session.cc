#include "client_sdk/src/tracker/tracking_session.h"

#include "client_sdk/src/tracker/depth_points.h"
#include "client_sdk/src/tracker/keyframe_export.h"

#include <algorithm>
#include <utility>
namespace mapp::tracker {
namespace {

/// Features with depth that the first frame needs: a map begun on less is soon lost.
constexpr size_t kMinStartPoints = 100;
/// Keyframes waiting for local mapping beyond which no further one is made.
constexpr size_t kMaxWaitingKeyframes = 3;
/// Points that a pose found without a guess must rest on.
constexpr int kMinRelocalizedPoints = 40;
/// Frames that a map from two views must track in a row before anybody is told of it. A false one explains the two, not
/// what comes after.
constexpr int kNumProbationFrames = 8;

}  // namespace

TrackingSession::TrackingSession(const TrackingCamera& camera, const OrbTrackerOptions& options)
    : camera_(camera),
      options_(options),
      relocalizer_(camera_, std::max(options.min_tracked_points, kMinRelocalizedPoints)),
      front_end_(shared_, camera_, options_, relocalizer_),
      shared_localizer_(shared_, camera_, options_),
      keyframe_policy_(shared_, camera_, options_),
      mono_initializer_(camera_),
      mapper_(shared_, camera_, options_) {}

void TrackingSession::TakeSharedMap(const SharedMap& map) {
  if (const std::optional<int> retired = shared_localizer_.Take(map)) RetireGeneration(*retired);
}

void TrackingSession::LeaveSharedMap() {
  bool was_adopted = false;
  if (const std::optional<int> retired = shared_localizer_.Leave(&was_adopted)) RetireGeneration(*retired);
  if (was_adopted) keyframe_policy_.ForceNext();
}

TrackingResult TrackingSession::Track(const std::shared_ptr<const Frame>& frame) {
  TrackingResult result = state_ == TrackingState::kNotStarted ? Start(frame) : TrackStarted(frame);
  state_ = result.state;
  result.T_odometry_session = T_odometry_session_;
  if (result.on_shared_map) result.T_map_session = shared_localizer_.T_map_session();
  if (state_ == TrackingState::kTracking) trajectory_.Add(*front_end_.last(), result.T_map_session);
  if (on_probation_) Examine(&result);
  return result;
}

void TrackingSession::Examine(TrackingResult* result) {
  num_examined_ = state_ == TrackingState::kTracking ? num_examined_ + 1 : 0;
  on_probation_ = num_examined_ <= kNumProbationFrames;
  if (on_probation_) *result = TrackingResult();
}

std::vector<Keyframe> TrackingSession::TakeKeyframes() {
  if (on_probation_) return {};
  return mapper_.TakeFinished();
}

std::vector<TrajectoryPose> TrackingSession::Trajectory() const {
  if (on_probation_) return {};
  return trajectory_.Compose(shared_);
}

bool TrackingSession::CanStart(const Frame& frame) const {
  if (!camera_.metric()) return MonoInitializer::ShowsEnough(frame);
  return FeaturesForPoints(frame, camera_).size() >= kMinStartPoints;
}

TrackingResult TrackingSession::Start(const std::shared_ptr<const Frame>& frame) {
  if (!camera_.metric()) return StartFromTwoViews(frame);
  TrackingResult result;
  if (!CanStart(*frame)) return result;
  TrackedFrame first;
  first.frame = frame;
  first.points.assign(frame->size(), kNone);
  front_end_.SetLast(std::move(first), /*consecutive=*/false);
  InsertKeyframe();
  result.state = TrackingState::kTracking;
  result.num_matches = static_cast<int>(FeaturesForPoints(*frame, camera_).size());
  result.is_keyframe = true;
  return result;
}

TrackingResult TrackingSession::StartFromTwoViews(const std::shared_ptr<const Frame>& frame) {
  TrackingResult result;
  const std::optional<TwoViewStart> start = mono_initializer_.Try(frame);
  if (!start) return result;
  InsertTwoViews(*start);
  on_probation_ = true;
  result.state = TrackingState::kTracking;
  return result;
}

TrackingResult TrackingSession::TrackStarted(const std::shared_ptr<const Frame>& frame) {
  TrackingResult result;
  front_end_.Refresh();
  std::optional<PoseEstimate> estimate;
  if (state_ == TrackingState::kTracking) estimate = front_end_.TrackFromLast(*frame);
  const TrackedFrame& last = *front_end_.last();
  const PoseBound bound =
      estimate ? PoseBound::AroundGuess(estimate->T_session_camera, last.metre)
               : PoseBound::SinceLost(last.T_session_camera,
                                      1e-9 * static_cast<double>(frame->stamp_ns - last.frame->stamp_ns), last.metre);
  if (TrackOnSharedMap(frame, estimate, bound, &result)) return result;

  if (!estimate) estimate = Relocalize(*frame, bound);
  std::optional<TrackedFrame> tracked;
  if (estimate) {
    tracked =
        front_end_.TrackLocalWindow(frame, *estimate, shared_localizer_.known_points(), shared_localizer_.generation());
  }
  if (!tracked) {
    result.state = TrackingState::kLost;
    return result;
  }
  Accept(*std::move(tracked), &result);
  return result;
}

bool TrackingSession::TrackOnSharedMap(const std::shared_ptr<const Frame>& frame,
                                       const std::optional<PoseEstimate>& estimate, const PoseBound& bound,
                                       TrackingResult* result) {
  if (!shared_localizer_.in_use()) return false;
  std::optional<Pose3> T_session_camera_guess;
  if (estimate) T_session_camera_guess = estimate->T_session_camera;
  const int generation_before = shared_localizer_.generation();
  SharedLocalizer::Outcome outcome = shared_localizer_.Localize(*frame, T_session_camera_guess, bound, relocalizer_);
  // Neither a success nor a failure to tell the participant of.
  if (outcome.undecided) return false;
  result->shared_map_number = outcome.shared_map_number;
  result->num_shared_matches = outcome.num_matches;
  if (!outcome.localized) return false;

  result->on_shared_map = true;
  TrackedFrame tracked;
  tracked.frame = frame;
  tracked.T_session_camera = outcome.estimate.T_session_camera;
  tracked.points = std::move(outcome.estimate.points);
  if (outcome.newly_adopted) {
    RetireGeneration(generation_before);
    keyframe_policy_.OnPoseCorrection(tracked);
    state_ = TrackingState::kLost;  // the step onto the shared map is a correction, not a motion
    if (T_session_camera_guess) {
      T_odometry_session_ = T_odometry_session_ * *T_session_camera_guess * tracked.T_session_camera.Inverse();
    }
  }
  Accept(std::move(tracked), result);
  return true;
}

std::optional<PoseEstimate> TrackingSession::Relocalize(const Frame& frame, const PoseBound& bound) const {
  if (auto found = relocalizer_.FindAmongKeyframes(frame, shared_, bound)) return found;
  if (shared_localizer_.known_points().empty()) return std::nullopt;
  return relocalizer_.FindAmongPoints(frame, camera_.shared_map, shared_localizer_.known_points(), bound);
}

void TrackingSession::Accept(TrackedFrame tracked, TrackingResult* result) {
  result->state = TrackingState::kTracking;
  result->T_session_camera = tracked.T_session_camera;
  result->num_matches = static_cast<int>(
      std::count_if(tracked.points.begin(), tracked.points.end(), [](int point_idx) { return point_idx != kNone; }));
  front_end_.SetLast(std::move(tracked), /*consecutive=*/state_ == TrackingState::kTracking);
  if (!keyframe_policy_.IsDue(*front_end_.last(), result->on_shared_map)) return;
  if (result->on_shared_map) {
    result->would_be_keyframe = true;
    keyframe_policy_.OnKeyframe(*front_end_.last());
  } else if (mapper_.num_waiting() < kMaxWaitingKeyframes) {
    result->is_keyframe = true;
    InsertKeyframe();
  }
}

void TrackingSession::InsertKeyframe() {
  const TrackedFrame& last = *front_end_.last();
  const Frame& frame = *last.frame;
  const int generation = shared_localizer_.generation();
  int keyframe_idx = kNone;
  std::vector<int> points;
  {
    MutexLock lock(shared_.mutex);
    SessionMap& map = shared_.map;
    keyframe_idx = map.AddKeyframe(last.frame, last.T_session_camera, last.points, generation);
    for (const size_t feature : FeaturesForPoints(frame, camera_)) {
      if (map.keyframe(keyframe_idx).points[feature] != kNone) continue;
      const Eigen::Vector3d p_session = DepthPoint(frame, feature, camera_, last.T_session_camera);
      map.AddPoint(p_session, keyframe_idx, static_cast<int>(feature));
    }
    points = map.keyframe(keyframe_idx).points;
  }
  keyframe_policy_.OnKeyframe(last);
  front_end_.SetLastKeyframe(keyframe_idx, std::move(points));
  relocalizer_.AddKeyframe(keyframe_idx, generation, frame);
  mapper_.ProcessKeyframe(keyframe_idx);
}

void TrackingSession::InsertTwoViews(const TwoViewStart& start) {
  TrackedFrame second;
  second.frame = start.second;
  second.T_session_camera = start.T_session_second;
  const int generation = shared_localizer_.generation();
  int first_idx = kNone, second_idx = kNone;
  {
    MutexLock lock(shared_.mutex);
    SessionMap& map = shared_.map;
    first_idx = map.AddKeyframe(start.first, Pose3(), std::vector<int>(start.first->size(), kNone), generation);
    second_idx = map.AddKeyframe(start.second, start.T_session_second, std::vector<int>(start.second->size(), kNone),
                                 generation);
    for (const TwoViewStart::Point& point : start.points) {
      const int point_idx = map.AddPoint(point.p_session, first_idx, point.first_feature_idx);
      map.AddObservation(point_idx, second_idx, point.second_feature_idx);
      map.UpdateView(point_idx);
    }
    second.points = map.keyframe(second_idx).points;
    second.metre = camera_.MetreAt(map.MedianDepth(second_idx));
  }
  front_end_.SetLast(second, /*consecutive=*/false);
  keyframe_policy_.OnKeyframe(*front_end_.last());
  front_end_.SetLastKeyframe(second_idx, std::move(second.points));
  relocalizer_.AddKeyframe(first_idx, generation, *start.first);
  relocalizer_.AddKeyframe(second_idx, generation, *start.second);
  mapper_.ProcessKeyframe(first_idx);
  mapper_.ProcessKeyframe(second_idx);
}

void TrackingSession::RetireGeneration(int generation) {
  relocalizer_.RetireGeneration(generation);
  mapper_.RetireGeneration(generation);
}

std::optional<Keyframe> TrackingSession::MakeKeyframeOfLastFrame() {
  if (state_ != TrackingState::kTracking || on_probation_) return std::nullopt;
  const TrackedFrame& last = *front_end_.last();
  MutexLock lock(shared_.mutex);
  return ExportFrame(shared_.map, camera_, *last.frame, last.T_session_camera, last.points);
}

}  // namespace mapp::tracker
