#pragma once

#include "client_sdk/src/tracker/front_end.h"
#include "client_sdk/src/tracker/session_map.h"
#include "mapp/client/orb_tracker.h"

#include <vector>

namespace mapp::tracker {

/// Every tracked frame, relative to its reference keyframe, so that the trajectory follows the map's corrections.
/// Frames on a shared map stay where they were localized. Tracking thread only.
class TrajectoryLog {
 public:
  void Add(const TrackedFrame& tracked, bool on_shared_map);
  std::vector<TrajectoryPose> Compose(const SharedSessionMap& shared) const;

 private:
  struct Entry {
    int64_t stamp_ns = 0;
    int reference_keyframe_idx = kNone;
    Pose3 T_reference_camera;  ///< T_session_camera without a reference keyframe
    bool on_shared_map = false;
  };
  std::vector<Entry> entries_;
};

}  // namespace mapp::tracker
