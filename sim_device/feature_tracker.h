#pragma once

#include "mapp/client/orb_tracker.h"
#include "mapp/client/slam_adapter.h"
#include "sim/features/feature_camera.h"
#include "sim_device/odometry.h"

#include <cstdint>
#include <memory>
#include <optional>
#include <vector>

namespace mapp::sim {

struct FeatureTrackerOptions {
  OrbTrackerOptions thresholds;  ///< what it shares with the built-in tracker: keyframes, matches that localize
  FeatureNoise camera;
  OdometryNoise odometry;
  /// On a shared map every so many frames are localized, and those that would be keyframes; range [1, 100]. In between
  /// the odometry goes on from the last.
  int localize_every = 3;
  uint64_t seed = 1;  ///< of all noise

  Status Validate() const;  ///< INVALID_ARGUMENT naming the first field out of range.
};

/// A SLAM system that sees features instead of images: true motion with drift, a map of its own made of landmarks, and
/// localization on shared maps by the built-in tracker's own code. Looks at few frames: keyframes, and some of those on
/// a shared map. Threads as OrbTracker.
class FeatureTracker final : public SlamAdapter {
 public:
  /// Mono is refused with INVALID_ARGUMENT, as by the built-in tracker.
  static StatusOr<std::unique_ptr<FeatureTracker>> Create(std::shared_ptr<const FeatureWorld> world,
                                                          const CameraRig& rig, const FeatureTrackerOptions& options);
  ~FeatureTracker() override;

  /// The next frame, taken at the true pose. `shared_map_number` of the result is set for frames that were compared
  /// with the shared map.
  TrackingResult Track(const Pose3& T_world_camera, int64_t stamp_ns);
  /// Keyframes made since the last call, whole, numbered from 0.
  std::vector<Keyframe> TakeKeyframes();
  /// A whole keyframe of the last frame that was looked at.
  std::optional<Keyframe> MakeKeyframeOfLastFrame();

  void TakeSharedMap(std::shared_ptr<const SharedMap> map) override;
  void LeaveSharedMap() override;

  std::vector<TrajectoryPose> Trajectory() const;
  const Camera& camera() const;  ///< stereo: the rectified left camera
  SensorKind sensor() const;

 private:
  struct Impl;
  explicit FeatureTracker(std::unique_ptr<Impl> impl);
  std::unique_ptr<Impl> impl_;
};

}  // namespace mapp::sim
