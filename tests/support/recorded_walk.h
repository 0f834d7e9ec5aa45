#pragma once

#include "mapp/base/status.h"
#include "mapp/map/keyframe.h"

#include <string>
#include <vector>

namespace mapp::testing {

/// Keyframes of a recorded sequence as a device that tracks perfectly would send them: ORB features, points with the
/// camera's depth, the same point number wherever a point is seen again, poses from the ground truth.
struct RecordedWalk {
  Camera camera;
  /// Poses in the session's frame, which is the first keyframe's camera.
  std::vector<Keyframe> keyframes;
  std::vector<Pose3> T_world_cameras;  ///< per keyframe

  Pose3 T_world_session() const { return T_world_cameras.front(); }
};

/// Takes every `stride`-th frame. `depth_when_missing_m` stands in for the depth of sequences without a depth image.
StatusOr<RecordedWalk> LoadRecordedWalk(const std::string& folder, size_t stride, float depth_when_missing_m = 0);

/// The recorded data, or empty when it is not there.
std::string DataFolder();

}  // namespace mapp::testing
