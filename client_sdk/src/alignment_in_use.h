#pragma once

#include "mapp/client/orb_tracker.h"
#include "mapp/geometry/pose3.h"

#include <cstdint>
#include <optional>

namespace mapp {

/// With which alignment a frame's pose goes into the map. A frame on a shared map: that with which the map was
/// received, as its points are placed by it. Mapping that goes on among these points keeps it, so that leaving the map
/// is no step, until the server tells another than it told then. One thread only.
class AlignmentInUse {
 public:
  /// `told`: the server's alignment of the session now.
  std::optional<Sim3> For(const TrackingResult& frame, const std::optional<Sim3>& told) {
    if (frame.fragment != fragment_) last_ = std::nullopt;
    fragment_ = frame.fragment;
    if (frame.on_shared_map && frame.T_map_session && told) {
      last_ = OnSharedMap{{1, *frame.T_map_session}, *told};
    } else if (last_ && told && !AreSame(last_->told, *told)) {
      last_ = std::nullopt;
    }
    return last_ ? std::optional(last_->S_map_session) : told;
  }

 private:
  struct OnSharedMap {
    Sim3 S_map_session;
    Sim3 told;
  };

  static bool AreSame(const Sim3& a, const Sim3& b) {
    return a.scale == b.scale && a.pose.translation() == b.pose.translation() &&
           a.pose.rotation().coeffs() == b.pose.rotation().coeffs();
  }

  uint32_t fragment_ = 0;
  std::optional<OnSharedMap> last_;  ///< the latest frame on a shared map, while it counts
};

}  // namespace mapp
