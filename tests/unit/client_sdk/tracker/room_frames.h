#pragma once

#include "datasets/sequence.h"
#include "mapp/camera/camera_model.h"
#include "mapp/client/orb_tracker.h"
#include "mapp/client/shared_map.h"
#include "mapp/geometry/pose3.h"
#include "mapp/map/keyframe.h"

#include <cstddef>
#include <memory>
#include <vector>

namespace mapp::tracker_test {

/// Frames of the rendered room with their true poses; drawn once per process.
struct RoomFrames {
  Camera camera;
  std::vector<SequenceFrame> frames;
  std::vector<Pose3> T_world_camera;
};
const RoomFrames& FirstRoomFrames();

/// The same views by a pair of cameras 0.12 m apart, without depth images.
struct RoomStereo {
  Camera camera;
  Pose3 T_left_right;
  std::vector<SequenceFrame> frames;
  std::vector<Pose3> T_world_camera;
};
RoomStereo MakeRoomStereo(size_t num_frames);

/// Borrows the frame's images.
TrackerFrame Borrow(const SequenceFrame& frame);

/// Options of repeatable runs.
OrbTrackerOptions SynchronousOptions();

/// The points of keyframes as a server would share them: ids are the session's plus `first_id`, positions moved by
/// T_target_source.
SharedMap MakeSharedMap(const std::vector<Keyframe>& keyframes, const Camera& camera, const Pose3& T_target_source,
                        uint32_t number, uint64_t first_id);

}  // namespace mapp::tracker_test
