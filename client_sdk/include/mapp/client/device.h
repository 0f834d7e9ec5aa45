#pragma once

#include "mapp/client/orb_tracker.h"
#include "mapp/client/participant.h"

#include <memory>
#include <optional>

namespace mapp {

struct DevicePose {
  TrackingResult tracking;
  std::optional<Pose3> T_map_camera;  ///< once the session is aligned and the frame is tracked
};

/// The built-in tracker joined to a participant: what most apps use. Track() belongs to one thread.
class Device {
 public:
  static StatusOr<std::unique_ptr<Device>> Open(std::unique_ptr<OrbTracker> tracker,
                                                const MapClientOptions& client_options,
                                                const ParticipantOptions& options);
  ~Device();

  StatusOr<DevicePose> Track(const TrackerFrame& frame);
  /// Waits until all that the frames so far have caused is done, here and at the server: for repeatable replays.
  Status WaitIdle(std::chrono::milliseconds timeout);
  Status Close(std::chrono::milliseconds timeout, bool wait_for_optimization);

  /// Frames tracked so far in the map's frame; nullopt while the session is not aligned.
  std::optional<std::vector<TrajectoryPose>> TrajectoryInMap() const;
  const OrbTracker& tracker() const;
  const Participant& participant() const;
  /// Frames of TrackingResult::would_be_keyframe, as upload_all would have sent them.
  const KeyframeTotals& keyframe_equivalents() const;

 private:
  struct Impl;
  explicit Device(std::unique_ptr<Impl> impl);
  std::unique_ptr<Impl> impl_;
};

}  // namespace mapp
