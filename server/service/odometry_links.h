#pragma once

#include "server/service/frame_view.h"
#include "vision/bundle_adjustment.h"

#include <map>
#include <vector>

namespace mapp {

/// What the devices' odometry tells of frames next to each other, for an adjustment. A partial keyframe comes without
/// the points that the map knew and may share next to none with it: its own points alone would leave it free to float.
class OdometryLinks {
 public:
  /// A frame of the adjustment, with the pose that its device sent.
  void Add(int frame_idx, const FrameView& view);
  /// One link for each two frames that follow each other in a session, as far as they were added. Of metric sessions
  /// only. Errors: the reader's.
  StatusOr<std::vector<BundleProblem::RelativePose>> Build(MapReader& reader) const;

 private:
  struct Sent {
    int frame_idx = 0;
    PoseFrame pose_frame = PoseFrame::kSession;
    Pose3 T_frame_camera;
  };
  std::map<SessionId, std::map<uint32_t, Sent>> sessions_;  ///< by keyframe number
};

}  // namespace mapp
