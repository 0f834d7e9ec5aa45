#pragma once

#include "mapp/client/shared_map.h"
#include "mapp/map/keyframe.h"

#include <cstdint>
#include <memory>
#include <vector>

namespace mapp {

/// What a SLAM system offers to take part in a shared map (DESIGN 13). `Participant` calls these from its own network
/// thread: they must not block; take the value, act on it in the tracking thread.
class SlamAdapter {
 public:
  virtual ~SlamAdapter() = default;

  /// Use this as the local map from the next frame on and let local mapping rest, until fewer than the failure
  /// threshold of its points match (then report it with Participant::OnSharedMapFrame) or it is taken back.
  virtual void TakeSharedMap(std::shared_ptr<const SharedMap> map) = 0;
  /// Go back to your own mapping. The points may be kept as known points: they carry the server's ids.
  virtual void LeaveSharedMap() = 0;
};

/// How a frame fared on the shared map.
struct SharedMapFrame {
  uint32_t shared_map_number = 0;
  int num_matches = 0;
  /// Enough of the shared points matched to trust the pose: at least 75 (DESIGN 3), and for the built-in tracker also
  /// over half of the view (OrbTrackerOptions::min_shared_matches).
  bool localized = false;
  Pose3 T_session_camera;
};

}  // namespace mapp
