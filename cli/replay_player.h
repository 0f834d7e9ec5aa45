#pragma once

#include "cli/frame_log.h"
#include "cli/replay.h"
#include "datasets/sequence.h"
#include "mapp/base/status.h"
#include "mapp/client/device.h"

#include <chrono>
#include <memory>
#include <stop_token>
#include <vector>

namespace mapp {

/// How one played frame went.
struct PlayedFrame {
  int64_t stamp_ns = 0;
  bool tracked = false;
  bool on_shared_map = false;
  FrameRole role = FrameRole::kOrdinary;
  double tracking_ms = 0;
  double tracking_cpu_ms = 0;  ///< of the tracking thread
  double reading_cpu_s = 0;    ///< of the process while the frame was read or drawn
};

struct PlayedFrames {
  std::vector<PlayedFrame> frames;
  Status status;  ///< why it ended before the last frame: CANCELLED by a stop request, else the error
};

/// The built-in tracker for the sequence's sensors. INVALID_ARGUMENT for a single camera.
StatusOr<std::unique_ptr<OrbTracker>> MakeTracker(const Sequence& sequence);

/// Feeds the sequence to the device, with a progress bar.
PlayedFrames Play(const Sequence& sequence, ReplayRate rate, std::chrono::milliseconds patience,
                  const std::stop_token& stop, Device& device);

}  // namespace mapp
