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

/// Finds the pose of a frame without a guess: candidates by descriptors, PnP by RANSAC, then a guided search that has
/// to agree. A wrong pose is worse than staying lost. Tracking thread only.
class Relocalizer {
 public:
  Relocalizer(const TrackingCamera& camera, int min_inliers);

  void AddKeyframe(int keyframe_idx, int generation, const Frame& frame);
  void RetireGeneration(int generation);

  /// Against the keyframes of the map that look most alike. The lock is taken briefly, per candidate.
  std::optional<PoseEstimate> FindAmongKeyframes(const Frame& frame, const SharedSessionMap& shared) const;
  /// Against points by their descriptors alone: about 1.2 ms per thousand points.
  std::optional<PoseEstimate> FindAmongPoints(const Frame& frame, std::span<const PointView> points) const;

 private:
  std::optional<PoseEstimate> Verify(const Frame& frame, const DepthTrust& trust, std::span<const PointView> candidates,
                                     std::span<const PointView> all_points) const;

  const TrackingCamera& camera_;
  const int min_inliers_;
  PlaceIndex index_;
  std::map<int, std::vector<int>> keyframes_by_generation_;
};

}  // namespace mapp::tracker
