#pragma once

#include "client_sdk/src/tracker/session_map.h"
#include "mapp/geometry/pose3.h"

#include <span>
#include <vector>

namespace mapp::tracker {

/// The part of the map that a frame should see, copied out for tracking.
struct LocalWindow {
  std::vector<PointView> points;
  int reference_keyframe_idx = kNone;  ///< shares most points with the frame
};

/// Gathers the points of the keyframes that share points with a frame, of those covisible with them, and of those that
/// stand near it and look the same way: the last is what closes small loops, since a place seen again is matched
/// against its old points instead of being mapped anew. `metre` is what stands for one (TrackingCamera::MetreAt).
LocalWindow GatherLocalWindow(const SessionMap& map, std::span<const int> frame_points, const Pose3& T_session_camera,
                              double metre, int generation);

/// Copies of the points a frame or keyframe observes; points fused or removed since are followed or left out.
std::vector<PointView> CopyPoints(const SessionMap& map, std::span<const int> points);

}  // namespace mapp::tracker
