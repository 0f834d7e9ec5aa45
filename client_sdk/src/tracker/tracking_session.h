#pragma once

#include "client_sdk/src/tracker/frame.h"
#include "client_sdk/src/tracker/front_end.h"
#include "client_sdk/src/tracker/keyframe_policy.h"
#include "client_sdk/src/tracker/local_mapper.h"
#include "client_sdk/src/tracker/mono_initializer.h"
#include "client_sdk/src/tracker/relocalizer.h"
#include "client_sdk/src/tracker/session_map.h"
#include "client_sdk/src/tracker/shared_localizer.h"
#include "client_sdk/src/tracker/trajectory_log.h"
#include "mapp/client/orb_tracker.h"

#include <memory>
#include <optional>
#include <vector>

namespace mapp::tracker {

/// One run of the tracker after image processing: decides per frame between the session's own map, a shared map and
/// relocalization, and when to make a keyframe. Tracking thread only, with the mapper's thread beside it.
class TrackingSession {
 public:
  TrackingSession(const TrackingCamera& camera, const OrbTrackerOptions& options);

  TrackingResult Track(const std::shared_ptr<const Frame>& frame);
  /// Whether a session could begin at this frame.
  bool CanStart(const Frame& frame) const;
  void TakeSharedMap(const SharedMap& map);
  void LeaveSharedMap();

  /// Whether a map begun from two views was lost while on probation. Nothing of it was told: drop the session.
  bool failed_to_start() const { return on_probation_ && state_ == TrackingState::kLost; }
  /// Those that local mapping has finished since the last call; none of a map on probation.
  std::vector<Keyframe> TakeKeyframes();
  /// Of the last frame, if it was tracked.
  std::optional<Keyframe> MakeKeyframeOfLastFrame();
  std::vector<TrajectoryPose> Trajectory() const;
  LocalMapper& mapper() { return mapper_; }
  const LocalMapper& mapper() const { return mapper_; }
  /// Made so far, with those that would have been made on shared maps.
  int num_keyframes() const { return keyframe_policy_.num_keyframes(); }

 private:
  /// Begins the session at this frame if it has enough depth.
  TrackingResult Start(const std::shared_ptr<const Frame>& frame);
  /// Mono: begins the session with this frame and an earlier one.
  TrackingResult StartFromTwoViews(const std::shared_ptr<const Frame>& frame);
  /// Hides the frames of a map on probation, and ends that when enough of them were tracked.
  void Examine(TrackingResult* result);
  TrackingResult TrackStarted(const std::shared_ptr<const Frame>& frame);
  /// Tries the shared map in use, if any; fills the result's fields about it. True when the frame is localized on it.
  bool TrackOnSharedMap(const std::shared_ptr<const Frame>& frame, const std::optional<PoseEstimate>& estimate,
                        const PoseBound& bound, TrackingResult* result);
  std::optional<PoseEstimate> Relocalize(const Frame& frame, const PoseBound& bound) const;
  /// Takes a tracked frame as the last one and makes it a (would-be) keyframe if that is due.
  void Accept(TrackedFrame tracked, TrackingResult* result);
  void InsertKeyframe();
  void InsertTwoViews(const TwoViewStart& start);
  void RetireGeneration(int generation);

  const TrackingCamera camera_;
  const OrbTrackerOptions options_;
  SharedSessionMap shared_;
  Relocalizer relocalizer_;
  FrontEnd front_end_;
  SharedLocalizer shared_localizer_;
  KeyframePolicy keyframe_policy_;
  TrajectoryLog trajectory_;
  Pose3 T_odometry_session_;
  MonoInitializer mono_initializer_;
  bool on_probation_ = false;
  int num_examined_ = 0;  ///< frames tracked while on probation
  TrackingState state_ = TrackingState::kNotStarted;
  LocalMapper mapper_;  ///< last: its thread uses what stands above
};

}  // namespace mapp::tracker
