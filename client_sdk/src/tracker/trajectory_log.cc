#include "client_sdk/src/tracker/trajectory_log.h"

namespace mapp::tracker {

void TrajectoryLog::Add(const TrackedFrame& tracked, const std::optional<Pose3>& T_map_session) {
  const bool has_reference = tracked.reference_keyframe_idx != kNone;
  entries_.push_back({tracked.frame->stamp_ns, tracked.reference_keyframe_idx,
                      has_reference ? tracked.T_reference_camera : tracked.T_session_camera, T_map_session});
}

std::vector<TrajectoryPose> TrajectoryLog::Compose(const SharedSessionMap& shared) const {
  std::vector<TrajectoryPose> poses;
  poses.reserve(entries_.size());
  MutexLock lock(shared.mutex);
  for (const Entry& entry : entries_) {
    Pose3 T_session_camera = entry.T_reference_camera;
    if (entry.reference_keyframe_idx != kNone) {
      T_session_camera = shared.map.keyframe(entry.reference_keyframe_idx).T_session_camera * T_session_camera;
    }
    poses.push_back({entry.stamp_ns, T_session_camera, entry.T_map_session.has_value(), entry.T_map_session});
  }
  return poses;
}

}  // namespace mapp::tracker
