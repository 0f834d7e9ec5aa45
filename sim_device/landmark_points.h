#pragma once

#include "client_sdk/src/tracker/session_map.h"
#include "client_sdk/src/tracker/tracking_camera.h"
#include "mapp/geometry/pose3.h"

#include <cstdint>
#include <span>
#include <unordered_map>
#include <vector>

namespace mapp::sim {

/// The session's own map of points, one a landmark while it stays in sight. Stands for a SLAM system's local mapping:
/// features find their points again by what they look like, positions are means of what was measured.
class LandmarkPoints {
 public:
  LandmarkPoints(tracker::SharedSessionMap& shared, const tracker::TrackingCamera& camera)
      : shared_(shared), camera_(camera) {}

  /// Adds a frame as a keyframe: its features' points, found again or new where they have a depth. `landmarks` has one
  /// entry per feature, 0 for clutter; `points` the features' points as far as known (of a shared map), else kNone.
  /// Returns the keyframe's index.
  int AddKeyframe(const std::shared_ptr<const tracker::Frame>& frame, std::span<const uint64_t> landmarks,
                  const Pose3& T_session_camera, std::vector<int> points, int generation);
  /// Forgets all landmarks: the session's poses were moved, and a new part of the map begins.
  void Forget() { tracks_.clear(); }

 private:
  struct Track {
    int point_idx = tracker::kNone;
    OrbDescriptor descriptor;  ///< as seen last
    double weight = 0;         ///< of the position so far, 1/m^2
    int last_keyframe_idx = 0;
  };

  /// The landmark's point if this feature would be taken for it.
  Track* FindTrack(const tracker::Frame& frame, size_t feature, uint64_t landmark, const Pose3& T_camera_session);
  void Improve(const tracker::Frame& frame, size_t feature, const Pose3& T_session_camera, Track& track);

  tracker::SharedSessionMap& shared_;
  const tracker::TrackingCamera& camera_;
  std::unordered_map<uint64_t, Track> tracks_;
};

}  // namespace mapp::sim
