#pragma once

#include "cli/frame_log.h"
#include "cli/map_info.h"
#include "mapp/geometry/pose3.h"

#include <cstdint>
#include <string>
#include <vector>

namespace mapp {

/// How a frame is marked in a picture.
enum class FrameMark {
  kNone,     ///< part of the trajectory only
  kWhole,    ///< a keyframe that was uploaded whole: all of it was fresh
  kPartial,  ///< a keyframe of which the fresh part was uploaded
  kShared,   ///< localised on a shared map where a keyframe would have been made: nothing was uploaded
};

struct TrackFrame {
  int64_t stamp_ns = 0;
  Pose3 T_map_camera;
  FrameMark mark = FrameMark::kNone;
  bool on_shared_map = false;
};

/// One session's way through the map, in order of time.
struct SessionTrack {
  uint64_t session_id = 0;
  std::string label;
  bool has_every_frame = false;  ///< from a frame log; otherwise keyframes only
  std::vector<TrackFrame> frames;

  /// Whether the device was tracked all the way from frame_idx - 1 to frame_idx, as far as the frames tell.
  bool IsContinuous(size_t frame_idx) const;
  size_t CountMarks(FrameMark mark) const;
};

/// One track for each session that has keyframes or a log, by session id. Keyframes that the map holds are marked as
/// the map has them, at the map's poses. `sessions` give the labels.
std::vector<SessionTrack> MakeTracks(const std::vector<MapFrameSummary>& keyframes, const std::vector<FrameLog>& logs,
                                     const std::vector<SessionSummary>& sessions);

}  // namespace mapp
