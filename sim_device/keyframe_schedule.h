#pragma once

#include "client_sdk/src/tracker/session_map.h"
#include "client_sdk/src/tracker/tracking_camera.h"
#include "mapp/client/orb_tracker.h"

#include <vector>

namespace mapp::sim {

/// Decides when a keyframe is due as the built-in tracker does (client_sdk/src/tracker/keyframe_policy.h), but tells
/// from the poses alone how much of the last keyframe a frame would find again: most frames are never looked at.
class KeyframeSchedule {
 public:
  KeyframeSchedule(const tracker::TrackingCamera& camera, const OrbTrackerOptions& options)
      : camera_(camera), options_(options) {}

  /// Counts the frame and says whether it should be a (would-be) keyframe; OnKeyframe confirms.
  bool IsDue(const Pose3& T_session_camera);
  /// `reference`: the keyframe's features with depth.
  void OnKeyframe(std::vector<tracker::PointView> reference);
  /// The session's poses were moved: the frame becomes what later ones are compared with, without being a keyframe.
  void SetReference(std::vector<tracker::PointView> reference);
  /// The next frame is due whatever it shows.
  void ForceNext() { forced_ = true; }

 private:
  /// How many of the reference's points would match: those in view, fewer as they are seen from elsewhere.
  double ExpectedMatches(const Pose3& T_session_camera) const;

  const tracker::TrackingCamera& camera_;
  const OrbTrackerOptions options_;
  std::vector<tracker::PointView> reference_;
  double most_matches_ = 0;
  int frames_since_keyframe_ = 0;
  int num_keyframes_ = 0;
  bool forced_ = false;
};

}  // namespace mapp::sim
