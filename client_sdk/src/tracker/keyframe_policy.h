#pragma once

#include "mapp/client/orb_tracker.h"

namespace mapp::tracker {

/// Decides when mapping needs another keyframe. On a shared map, where none is made, the same rule tells where one
/// would have been, so that both counts compare: it rests on the share of matches left since the last (would-be)
/// keyframe, which both kinds of tracking know. One thread only.
class KeyframePolicy {
 public:
  /// How a frame was tracked.
  struct Observation {
    int num_matches = 0;          ///< map points matched
    int num_close_matched = 0;    ///< features with a usable depth that have a point
    int num_close_unmatched = 0;  ///< ... that have none
  };

  explicit KeyframePolicy(const OrbTrackerOptions& options) : options_(options) {}

  /// Counts the frame and says whether it should be a (would-be) keyframe. The caller confirms with OnKeyframe.
  bool IsDue(const Observation& frame);
  void OnKeyframe(const Observation& frame);
  /// The next tracked frame is due whatever it matches.
  void ForceNext() { forced_ = true; }

 private:
  OrbTrackerOptions options_;
  int frames_since_keyframe_ = 0;
  int most_matches_ = 0;  ///< in one frame, since the last keyframe
  bool forced_ = false;
};

}  // namespace mapp::tracker
