#pragma once

#include "mapp/client/orb_tracker.h"
#include "mapp/client/participant.h"

#include <memory>
#include <optional>
#include <vector>

namespace mapp {

struct DevicePose {
  TrackingResult tracking;
  /// To steer by, when tracked: goes on smoothly where the device steps onto a shared map or leaves it. Drifts.
  Pose3 T_odometry_camera;
  /// Where the device is, once the session is aligned and the frame is tracked. Makes a step where the map knows
  /// better: T_map_camera * T_odometry_camera.Inverse() takes up the drift of the odometry. Leaving a shared map is no
  /// step.
  std::optional<Pose3> T_map_camera;
};

/// One fragment of a device's way: what it tracked without being lost for long.
struct DeviceFragment {
  ParticipantFragment session;
  std::vector<TrajectoryPose> trajectory;  ///< in the fragment's own frame `session`, unrelated to the others'
  /// Where the map has its keyframes, when it was asked: Device::FetchKeyframePoses.
  std::vector<ClientKeyframePose> keyframe_poses;
};
/// T_map_camera of the fragment's frames, in order; empty while it is not aligned. Frames localised on a shared map
/// stay where they were found. The others go where the map has their keyframes, those between two keyframes with both,
/// by time; without `keyframe_poses`, all with the session's alignment.
std::vector<TrajectoryPose> TrajectoryInMap(const DeviceFragment& fragment);
/// The frames of all aligned fragments, in order, as T_map_camera; nullopt where no fragment is aligned.
std::optional<std::vector<TrajectoryPose>> TrajectoryInMap(const std::vector<DeviceFragment>& fragments);
/// Fills `keyframe_poses` of the fragments, which are the participant's. Errors: as Participant::FetchKeyframePoses.
Status FetchKeyframePoses(Participant& participant, std::vector<DeviceFragment>& fragments);

/// The built-in tracker joined to a participant: what most apps use. Where the tracker begins a new fragment, the
/// device takes part with a session of its own for it, and tracking goes on meanwhile; the fragment has no pose in the
/// map until the server has found its place. Track() belongs to one thread.
class Device {
 public:
  /// `options.features` is not read: they are the tracker's.
  static StatusOr<std::unique_ptr<Device>> Open(std::unique_ptr<OrbTracker> tracker,
                                                const MapClientOptions& client_options,
                                                const ParticipantOptions& options);
  ~Device();

  StatusOr<DevicePose> Track(const TrackerFrame& frame);
  /// Waits until all that the frames so far have caused is done, here and at the server: for repeatable replays.
  Status WaitIdle(std::chrono::milliseconds timeout);
  Status Close(std::chrono::milliseconds timeout, bool wait_for_optimization);

  /// All fragments so far, the present one last.
  std::vector<DeviceFragment> fragments() const;
  /// Frames tracked so far in the map's frame, those of aligned fragments; nullopt while there is none.
  std::optional<std::vector<TrajectoryPose>> TrajectoryInMap() const { return mapp::TrajectoryInMap(fragments()); }
  /// Asks the server where the map has the keyframes of `fragments`, as fragments() gave them, for a trajectory that
  /// has all corrections made since. Waits for the server; after Close too. Errors: as Participant's.
  Status FetchKeyframePoses(std::vector<DeviceFragment>& fragments);
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
