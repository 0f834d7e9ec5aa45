#pragma once

#include "client_sdk/src/tracker/frame.h"
#include "client_sdk/src/tracker/point_search.h"
#include "client_sdk/src/tracker/relocalizer.h"
#include "client_sdk/src/tracker/session_map.h"
#include "client_sdk/src/tracker/tracking_camera.h"
#include "mapp/client/orb_tracker.h"

#include <memory>
#include <optional>
#include <span>
#include <vector>

namespace mapp::tracker {

/// A frame whose pose is known. With a reference keyframe the pose follows its corrections.
struct TrackedFrame {
  std::shared_ptr<const Frame> frame;
  Pose3 T_session_camera;
  std::vector<int> points;  ///< per feature: the map point it is an inlier of, or kNone
  int reference_keyframe_idx = kNone;
  Pose3 T_reference_camera;  ///< relative to the reference keyframe, where there is one
  double metre = 1;          ///< what stands for one in this view (TrackingCamera::MetreAt)
};

/// Follows the camera from frame to frame within the session's own map (and points of a shared map that are known):
/// constant-velocity prediction, else the looks of the last frame's points and the reference keyframe's; then the local
/// window. Tracking thread only.
class FrontEnd {
 public:
  FrontEnd(SharedSessionMap& shared, const TrackingCamera& camera, const OrbTrackerOptions& options,
           const Relocalizer& relocalizer)
      : shared_(shared), camera_(camera), options_(options), relocalizer_(relocalizer) {}

  /// Brings the last frame up to date with the map's corrections. Call it first for each frame.
  void Refresh();
  /// Pose from the last tracked frame; nullopt when too few points are found again.
  std::optional<PoseEstimate> TrackFromLast(const Frame& frame) const;
  /// Refines an estimate on the local window around it together with `known_points`. The result names the reference
  /// keyframe. nullopt when fewer points than options allow support it.
  std::optional<TrackedFrame> TrackLocalWindow(const std::shared_ptr<const Frame>& frame, const PoseEstimate& estimate,
                                               std::span<const PointView> known_points, int generation);

  /// The frame that the next one is tracked from. `consecutive`: it directly follows the last one, so that the motion
  /// between them predicts the next pose.
  void SetLast(TrackedFrame tracked, bool consecutive);
  /// Null before the first tracked frame.
  const TrackedFrame* last() const { return last_ ? &*last_ : nullptr; }
  /// Ties the last frame to a keyframe made of it.
  void SetLastKeyframe(int keyframe_idx, std::vector<int> points);

 private:
  std::vector<PointView> PointsOfLastFrame() const;
  std::vector<PointView> PointsOfReferenceKeyframe() const;
  Pose3 Predict(const Frame& frame) const;

  SharedSessionMap& shared_;
  const TrackingCamera& camera_;
  const OrbTrackerOptions& options_;
  const Relocalizer& relocalizer_;
  std::optional<TrackedFrame> last_;
  /// Motion between the last two frames, per second, in the camera's frame; zero unless they are consecutive.
  Eigen::Matrix<double, 6, 1> velocity_ = Eigen::Matrix<double, 6, 1>::Zero();
};

}  // namespace mapp::tracker
