#pragma once

#include "client_sdk/src/tracker/frame.h"
#include "client_sdk/src/tracker/point_search.h"
#include "client_sdk/src/tracker/session_map.h"
#include "client_sdk/src/tracker/tracking_camera.h"
#include "vision/place_index.h"

#include <map>
#include <optional>
#include <span>
#include <vector>

namespace mapp::tracker {

/// Where a device can be, given where it was. Places that look alike (aisles of a garage, floors, equal cars) cannot be
/// told apart by their looks, however many points agree; but a device does not jump from one to the other.
struct PoseBound {
  Pose3 T_session_camera;
  double max_distance_m = 0;
  double max_angle_rad = 0;

  /// Around the pose that the device's own tracking gives: how far a map of others may be off from the session's.
  /// `metre` is what stands for one (TrackingCamera::MetreAt).
  static PoseBound AroundGuess(const Pose3& T_session_camera, double metre = 1);
  /// Around the last known pose, `elapsed_s` ago.
  static PoseBound SinceLost(const Pose3& T_session_camera, double elapsed_s, double metre = 1);
  bool Holds(const Pose3& T_session_camera_found) const;
};

/// Finds the pose of a frame by looks: candidates by descriptors, PnP by RANSAC, then a guided search that has to
/// agree. A wrong pose is worse than staying lost: one outside the bound is not believed. Tracking thread only.
class Relocalizer {
 public:
  Relocalizer(const TrackingCamera& camera, int min_inliers);

  void AddKeyframe(int keyframe_idx, int generation, const Frame& frame);
  void RetireGeneration(int generation);

  /// Against the keyframes of the map that look most alike. The lock is taken briefly, per candidate.
  std::optional<PoseEstimate> FindAmongKeyframes(const Frame& frame, const SharedSessionMap& shared,
                                                 const PoseBound& bound) const;
  /// Against points by their descriptors alone: about 1.2 ms per thousand points. `trust`: in the frame's depths
  /// against these points.
  std::optional<PoseEstimate> FindAmongPoints(const Frame& frame, const DepthTrust& trust,
                                              std::span<const PointView> points, const PoseBound& bound) const;

 private:
  std::optional<PoseEstimate> Verify(const Frame& frame, const DepthTrust& trust, std::span<const PointView> candidates,
                                     std::span<const PointView> all_points, const PoseBound& bound) const;

  const TrackingCamera& camera_;
  const int min_inliers_;
  PlaceIndex index_;
  std::map<int, std::vector<int>> keyframes_by_generation_;
};

}  // namespace mapp::tracker
