#pragma once

#include "client_sdk/src/tracker/front_end.h"
#include "client_sdk/src/tracker/session_map.h"
#include "mapp/client/orb_tracker.h"

#include <optional>
#include <vector>

namespace mapp::tracker {

/// Every tracked frame, relative to its reference keyframe, so that the trajectory follows the map's corrections.
/// Frames on a shared map stay where they were localized. Tracking thread only.
class TrajectoryLog {
 public:
  /// `T_map_session`: of the shared map it was localised on; nullopt otherwise.
  void Add(const TrackedFrame& tracked, const std::optional<Pose3>& T_map_session);
  std::vector<TrajectoryPose> Compose(const SharedSessionMap& shared) const;

 private:
  struct Entry {
    int64_t stamp_ns = 0;
    int reference_keyframe_idx = kNone;
    Pose3 T_reference_camera;  ///< T_session_camera without a reference keyframe
    std::optional<Pose3> T_map_session;
  };
  std::vector<Entry> entries_;
};

}  // namespace mapp::tracker
