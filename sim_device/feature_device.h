#pragma once

#include "mapp/client/device.h"
#include "sim/world/visit.h"
#include "sim_device/feature_tracker.h"

#include <chrono>
#include <cstdint>
#include <memory>
#include <vector>

namespace mapp::sim {

/// A feature tracker joined to a participant: what mapp::Device is for the built-in tracker, and with the same figures.
/// Step() belongs to one thread.
class FeatureDevice {
 public:
  static StatusOr<std::unique_ptr<FeatureDevice>> Open(std::shared_ptr<const FeatureWorld> world, const CameraRig& rig,
                                                       const FeatureTrackerOptions& tracker_options,
                                                       const MapClientOptions& client_options,
                                                       const ParticipantOptions& options);
  ~FeatureDevice();

  /// The next frame, taken at the true pose.
  TrackingResult Step(const Pose3& T_world_camera, int64_t stamp_ns);
  /// As Device's.
  Status WaitIdle(std::chrono::milliseconds timeout);
  Status Close(std::chrono::milliseconds timeout, bool wait_for_optimization);
  std::vector<DeviceFragment> fragments() const;                      ///< one: it never gets lost
  Status FetchKeyframePoses(std::vector<DeviceFragment>& fragments);  ///< as Device's
  const FeatureTracker& tracker() const { return *tracker_; }
  const Participant& participant() const { return *participant_; }
  const KeyframeTotals& keyframe_equivalents() const { return keyframe_equivalents_; }

 private:
  explicit FeatureDevice(std::unique_ptr<FeatureTracker> tracker) : tracker_(std::move(tracker)) {}

  std::unique_ptr<FeatureTracker> tracker_;
  std::unique_ptr<Participant> participant_;  ///< ends first: it calls the tracker
  KeyframeTotals keyframe_equivalents_;
};

}  // namespace mapp::sim
