#pragma once

#include "client_sdk/src/tracker/front_end.h"
#include "client_sdk/src/tracker/session_map.h"
#include "client_sdk/src/tracker/tracking_camera.h"
#include "mapp/client/orb_tracker.h"

#include <vector>

namespace mapp::tracker {

/// Decides when mapping needs another keyframe. On a shared map, where none is made, the same rule tells where one
/// would have been: it asks how much of the last (would-be) keyframe's own features with depth is found again, which
/// does not depend on the map that the pose comes from, so that both counts compare. Without any depth it asks for the
/// map points that the keyframe was tracked on. Tracking thread only.
class KeyframePolicy {
 public:
  KeyframePolicy(const SharedSessionMap& shared, const TrackingCamera& camera, const OrbTrackerOptions& options)
      : shared_(shared), camera_(camera), options_(options) {}

  /// Counts the frame and says whether it should be a (would-be) keyframe. The caller confirms with OnKeyframe.
  bool IsDue(const TrackedFrame& tracked, bool on_shared_map);
  void OnKeyframe(const TrackedFrame& tracked);
  /// The step onto a shared map moves the session's poses: the frame takes the last keyframe's place as what later ones
  /// are compared with, without being one.
  void OnPoseCorrection(const TrackedFrame& tracked) { SetReference(tracked); }
  int num_keyframes() const { return num_keyframes_; }  ///< would-be ones counted
  /// The next tracked frame is due whatever it shows.
  void ForceNext() { forced_ = true; }

 private:
  void SetReference(const TrackedFrame& tracked);
  int CountReferenceMatches(const TrackedFrame& tracked) const;
  bool LacksClosePoints(const TrackedFrame& tracked) const;

  const SharedSessionMap& shared_;
  const TrackingCamera& camera_;
  const OrbTrackerOptions& options_;
  std::vector<PointView> reference_points_;  ///< the last keyframe's: features with depth; mono: map points
  int most_matches_ = 0;                     ///< of them in one frame, so far
  int frames_since_keyframe_ = 0;
  int num_keyframes_ = 0;
  bool forced_ = false;
};

}  // namespace mapp::tracker
