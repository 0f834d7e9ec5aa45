#pragma once

#include "mapp/geometry/pose3.h"
#include "server/service/own_frames.h"

#include <vector>

namespace mapp {

/// Frames that share so many points are where the map has each other.
inline constexpr int kMinJoiningPoints = 20;

/// A keyframe of a session found again where another frame of the map was.
struct LoopMatch {
  FrameId anchor;
  FrameId frame;
  Pose3 T_anchor_frame;  ///< as their common points have it, whatever the two frames' poses in the map
};

/// A place that a session has come back to with more drift than association bridges.
struct Loop {
  MapId map;
  OwnFrames visit;  ///< the part of the session that the matches are of
  std::vector<LoopMatch> matches;
};

/// What closing one changed.
struct ClosedLoop {
  size_t num_frames = 0;    ///< of the graph that was relaxed
  double max_motion_m = 0;  ///< of a frame
  uint32_t num_fused = 0;   ///< points that the visit showed twice
};

}  // namespace mapp
