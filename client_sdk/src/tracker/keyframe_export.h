#pragma once

#include "client_sdk/src/tracker/session_map.h"
#include "client_sdk/src/tracker/tracking_camera.h"
#include "mapp/map/keyframe.h"

#include <vector>

namespace mapp::tracker {

/// The keyframe as the protocol knows it (`number` and `session` are left at 0). Points nearer to the camera's
/// plane than TrackingCamera::min_point_depth_m, or behind it, are left out.
Keyframe ExportKeyframe(const SessionMap& map, const TrackingCamera& camera, int keyframe_idx);

/// The same of a frame that is not in the map. Its features with a usable depth and no point get one of their own,
/// under a name that is not used again.
Keyframe ExportFrame(SessionMap& map, const TrackingCamera& camera, const Frame& frame, const Pose3& T_session_camera,
                     const std::vector<int>& points);

}  // namespace mapp::tracker
