#pragma once

#include "datasets/sequence.h"
#include "mapp/base/status.h"
#include "sim/sensor_noise.h"
#include "sim/sequence_writer.h"
#include "sim/world/visit.h"

#include <cstddef>
#include <functional>
#include <memory>
#include <optional>
#include <string>

namespace mapp::sim {

/// How the images of a visit are taken.
struct ImageOptions {
  /// The depth camera of the paper's rigs reaches farther than the default's.
  SensorNoise noise{.max_depth_m = 10};
  double exposure = 1;                 ///< brightness is multiplied by this before noise is added, (0, 16]
  int motion_blur = 1;                 ///< pictures averaged over the exposure time, odd, in [1, 31]; 1: no blur
  std::optional<double> exposure_s{};  ///< [0, 0.1]; absent: the rig's
  bool with_color = false;             ///< ReadColored() gives colours
  int num_threads = 2;                 ///< that draw one frame, [1, 256]
};

/// A visit as a sequence, drawn frame by frame when read; nothing touches the disk. Thread-safe.
class VisitSequence : public Sequence {
 public:
  /// FAILED_PRECONDITION unless opened with colour.
  virtual StatusOr<ColoredFrame> ReadColored(size_t frame_idx) const = 0;
};

/// Times, noise and everything else follow from the simulation and the options: the same every time. INVALID_ARGUMENT
/// naming the option, or `user`: not one of the simulation's.
StatusOr<std::unique_ptr<VisitSequence>> OpenVisit(std::shared_ptr<const Simulation> simulation, int user,
                                                   const ImageOptions& options = {});

/// Writes a user's visit as WriteSequence() does, with its IMU where the layout has one; in colour if `options` say so.
Status WriteVisit(const std::shared_ptr<const Simulation>& simulation, int user, const ImageOptions& options,
                  const std::string& folder, const std::function<bool(size_t num_written)>& progress = {});

}  // namespace mapp::sim
