#pragma once

#include "datasets/sequence.h"
#include "mapp/base/status.h"
#include "mapp/geometry/pose3.h"
#include "mapp/image/image.h"
#include "sim/world/imu.h"

#include <array>
#include <cstddef>
#include <cstdint>
#include <functional>
#include <span>
#include <string>

namespace mapp::sim {

/// A frame, and its left or colour image in colour.
struct ColoredFrame {
  SequenceFrame frame;
  Image<std::array<uint8_t, 3>> color;  ///< red, green, blue
};

struct SequenceWriterOptions {
  double rate_hz = 0;                ///< what the calibration says; informative
  Pose3 T_body_camera;               ///< of the left camera
  std::span<const ImuSample> imu{};  ///< EuRoC layout only; empty: no imu0
  double imu_rate_hz = 200;
  /// Gives the frames where the left or colour camera's images shall be written in colour; empty: gray ones.
  std::function<StatusOr<ColoredFrame>(size_t frame_idx)> read_colored{};
  /// Called after each frame with the number written; false stops.
  std::function<bool(size_t num_written)> progress{};
};

/// Writes a sequence as a folder that OpenSequence() reads back: RGB-D in the TUM layout (depth in steps of 0.2 mm up
/// to 13 m, 0 beyond), all others in the EuRoC ASL layout (docs/formats/sequence.md). `folder` is created; files in it
/// are overwritten. RESOURCE_EXHAUSTED naming the file when something cannot be written, CANCELLED when `progress`
/// stopped it, errors of reading and drawing.
Status WriteSequence(const Sequence& sequence, const std::string& folder, const SequenceWriterOptions& options);

}  // namespace mapp::sim
