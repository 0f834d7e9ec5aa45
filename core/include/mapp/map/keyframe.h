#pragma once

#include "mapp/base/id.h"
#include "mapp/base/status.h"
#include "mapp/camera/camera_model.h"
#include "mapp/feature/feature.h"
#include "mapp/feature/feature_settings.h"
#include "mapp/geometry/pose3.h"
#include "mapp/map/depth_raster.h"

#include <cstdint>
#include <optional>
#include <vector>

namespace mapp {

/// Frame that a device's pose is expressed in: its odometry frame, or the map once it localises on a shared map.
enum class PoseFrame : uint8_t { kSession = 0, kMap = 1 };

/// How a device names a map point: by its own number within the session, or by the server's id once it knows it.
struct PointReference {
  enum class Kind : uint8_t { kSessionPoint = 0, kMapPoint = 1 };
  Kind kind = Kind::kSessionPoint;
  uint64_t id = 0;
  /// Depth of the point along the keyframe's optical axis as the device's map has it, metres, > 0.
  float depth_m = 0;
  /// In how many keyframes the device has observed the point so far, >= 1.
  uint16_t num_observations = 1;
};

struct KeyframeFeature {
  Keypoint keypoint;
  OrbDescriptor descriptor;
  std::optional<PointReference> point;
};

/// A keyframe as a device sends it (DESIGN 2): whole, or what redundancy control left of it.
struct Keyframe {
  SessionId session;
  /// `K` of the paper: counts the session's keyframes from 0; (session, number) is the upload's idempotency key.
  uint32_t number = 0;
  int64_t stamp_ns = 0;
  PoseFrame pose_frame = PoseFrame::kSession;
  /// T_session_camera or T_map_camera, as `pose_frame` says.
  Pose3 T_frame_camera;
  /// Redundancy control has removed features.
  bool partial = false;
  /// Redundant share of the device's own points by its own count, when it has asked for an answer (DESIGN 5).
  std::optional<float> overlap;
  std::vector<KeyframeFeature> features;
  /// Of all that the view measured, also of features that redundancy control removed or that are too far to make points
  /// of. Without it a partial keyframe says nothing of what is gone (DESIGN 10).
  std::optional<DepthRaster> raster;
};

/// The raster of the keyframe's own points: for trackers that know no more.
DepthRaster RasterOf(const Keyframe& keyframe, const Camera& camera);

/// Greatest coordinate a pose or point may have, metres (DESIGN 4).
inline constexpr double kMaxCoordinateM = 1e6;
/// A point's depth is less than this, metres.
inline constexpr float kMaxPointDepthM = 10000.0F;

/// INVALID_ARGUMENT naming the field: non-finite or absurd pose, too many features, depth not in (0, 10000) m,
/// a keypoint outside the image, an octave that the feature settings do not have, a raster that Validate refuses.
Status Validate(const Keyframe& keyframe, const Camera& camera, const FeatureSettings& features);

}  // namespace mapp
