#pragma once

#include "datasets/sequence.h"
#include "mapp/base/status.h"
#include "mapp/client/device.h"

#include <chrono>
#include <cstdint>
#include <memory>
#include <optional>
#include <string>
#include <vector>

namespace mapp {

/// At which level a sequence is played.
enum class ReplayLevel {
  kImages,    ///< images through the built-in tracker
  kFeatures,  ///< a simulated world's features through a device without images: far faster
};

/// How one frame was played.
struct PlayedStep {
  TrackingResult tracking;
  double reading_cpu_s = 0;  ///< CPU time of the process while the frame was read or drawn
};

/// A device that plays one sequence, joined to a map. One thread only.
class ReplayDevice {
 public:
  virtual ~ReplayDevice() = default;
  virtual StatusOr<PlayedStep> Play(size_t frame_idx) = 0;
  /// As Device's.
  virtual Status WaitIdle(std::chrono::milliseconds timeout) = 0;
  virtual Status Close(std::chrono::milliseconds timeout, bool wait_for_optimization) = 0;
  virtual std::vector<DeviceFragment> fragments() const = 0;
  virtual Status FetchKeyframePoses(std::vector<DeviceFragment>& fragments) = 0;  ///< as Device's
  virtual ParticipantStats stats() const = 0;                                     ///< of all fragments
  /// Whether the fragments' lengths are metres; else each has a unit of its own until it is aligned.
  virtual bool metric() const = 0;
  virtual KeyframeTotals keyframe_equivalents() const = 0;
  virtual LocalMappingStats local_mapping() const = 0;
};

/// What `mapp replay` plays.
class ReplaySource {
 public:
  virtual ~ReplaySource() = default;
  virtual const std::string& name() const = 0;
  virtual size_t num_frames() const = 0;
  virtual int64_t stamp_ns(size_t frame_idx) const = 0;
  virtual const std::vector<StampedPose>& ground_truth() const = 0;  ///< T_world_camera; empty without
  /// A device for this source, which must outlive it. INVALID_ARGUMENT: a sensor that cannot be tracked.
  virtual StatusOr<std::unique_ptr<ReplayDevice>> Open(const MapClientOptions& client_options,
                                                       const ParticipantOptions& options) const = 0;
};

/// Opens what `mapp replay` takes as SEQUENCE; see OpenSequenceSource. INVALID_ARGUMENT: features of what is not
/// simulated.
StatusOr<std::unique_ptr<ReplaySource>> OpenReplaySource(const std::string& name, ReplayLevel level);

}  // namespace mapp
