#pragma once

#include "client_sdk/src/tracker/frame.h"
#include "client_sdk/src/tracker/tracking_camera.h"
#include "mapp/geometry/pose3.h"
#include "vision/two_view.h"

#include <Eigen/Core>

#include <memory>
#include <optional>
#include <vector>

namespace mapp::tracker {

/// A map begun from two views of one camera. The frame `session` is the first camera's; its unit is the median depth of
/// the points before that camera.
struct TwoViewStart {
  struct Point {
    Eigen::Vector3d p_session;
    int first_feature_idx = 0;
    int second_feature_idx = 0;
  };
  std::shared_ptr<const Frame> first, second;
  Pose3 T_session_second;
  std::vector<Point> points;
};

/// Waits for two frames that tell motion and structure without any depth: enough matches, enough parallax, one clear
/// solution that stands a bundle adjustment. Tracking thread only.
class MonoInitializer {
 public:
  explicit MonoInitializer(const TrackingCamera& camera) : camera_(camera) {}

  /// Whether the frame shows enough to begin from.
  static bool ShowsEnough(const Frame& frame);
  /// Compares the frame with the first one. A frame that has too little in common with that takes its place.
  std::optional<TwoViewStart> Try(const std::shared_ptr<const Frame>& frame);

 private:
  const TrackingCamera& camera_;
  std::shared_ptr<const Frame> first_;
};

}  // namespace mapp::tracker
