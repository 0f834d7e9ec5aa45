#pragma once

#include "cli/frame_log.h"
#include "cli/replay.h"
#include "cli/replay_source.h"
#include "mapp/base/status.h"

#include <chrono>
#include <stop_token>
#include <vector>

namespace mapp {

/// How one played frame went.
struct PlayedFrame {
  int64_t stamp_ns = 0;
  bool tracked = false;
  bool on_shared_map = false;
  int num_shared_matches = 0;  ///< points of the shared map that it was localized by
  FrameRole role = FrameRole::kOrdinary;
  double tracking_ms = 0;
  double tracking_cpu_ms = 0;    ///< of the tracking thread
  double extraction_cpu_ms = 0;  ///< of these
  double reading_cpu_s = 0;      ///< of the process while the frame was read or drawn
};

struct PlayedFrames {
  std::vector<PlayedFrame> frames;
  Status status;  ///< why it ended before the last frame: CANCELLED by a stop request, else the error
};

/// Plays all frames of the source on its device, with a progress bar.
PlayedFrames Play(const ReplaySource& source, ReplayRate rate, std::chrono::milliseconds patience,
                  const std::stop_token& stop, ReplayDevice& device);

}  // namespace mapp
