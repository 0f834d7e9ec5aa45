#pragma once

#include "client_sdk/src/tracker/frame.h"
#include "client_sdk/src/tracker/front_end.h"
#include "client_sdk/src/tracker/keyframe_policy.h"
#include "client_sdk/src/tracker/local_mapper.h"
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

  /// Of the last frame, if it was tracked.
  std::optional<Keyframe> MakeKeyframeOfLastFrame();
  std::vector<TrajectoryPose> Trajectory() const { return trajectory_.Compose(shared_); }
  LocalMapper& mapper() { return mapper_; }
  const LocalMapper& mapper() const { return mapper_; }
  /// Made so far, with those that would have been made on shared maps.
  int num_keyframes() const { return keyframe_policy_.num_keyframes(); }

 private:
  /// Begins the session at this frame if it has enough depth.
  TrackingResult Start(const std::shared_ptr<const Frame>& frame);
  TrackingResult TrackStarted(const std::shared_ptr<const Frame>& frame);
  /// Tries the shared map in use, if any; fills the result's fields about it. True when the frame is localized on it.
  bool TrackOnSharedMap(const std::shared_ptr<const Frame>& frame, const std::optional<PoseEstimate>& estimate,
                        const PoseBound& bound, TrackingResult* result);
  std::optional<PoseEstimate> Relocalize(const Frame& frame, const PoseBound& bound) const;
  /// Takes a tracked frame as the last one and makes it a (would-be) keyframe if that is due.
  void Accept(TrackedFrame tracked, TrackingResult* result);
  void InsertKeyframe();
  void RetireGeneration(int generation);

  const TrackingCamera camera_;
  const OrbTrackerOptions options_;
  SharedSessionMap shared_;
  Relocalizer relocalizer_;
  FrontEnd front_end_;
  SharedLocalizer shared_localizer_;
  KeyframePolicy keyframe_policy_;
  TrajectoryLog trajectory_;
  TrackingState state_ = TrackingState::kNotStarted;
  LocalMapper mapper_;  ///< last: its thread uses what stands above
};

}  // namespace mapp::tracker
