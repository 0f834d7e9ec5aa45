#pragma once

#include "mapp/map/keyframe.h"
#include "storage/map_store.h"

#include <optional>
#include <vector>

namespace mapp {

/// Points nearer than this to a camera are not looked for in its image.
inline constexpr double kMinDepthM = 0.05;

/// What a keyframe's depths are worth.
enum class DepthKind : uint8_t {
  kMeasured,      ///< by a sensor, in the map's unit
  kTriangulated,  ///< from the device's own way, in the map's unit
  kUnscaled,      ///< in a unit whose length in the map is not known yet
};

/// A stored frame with everything that geometry needs, decoded once.
struct FrameView {
  FrameRecord record;
  Camera camera;
  PinholeCamera pinhole;  ///< camera.Undistorted()
  /// As the device sent it, lengths in the map's unit once its session is aligned. Poses: use `record.T_frame_camera`,
  /// which the server may have corrected.
  Keyframe keyframe;
  DepthKind depths = DepthKind::kMeasured;
  /// Per feature: its pixel in the undistorted pinhole image, and the live map point it observes.
  std::vector<Eigen::Vector2d> undistorted_px;
  std::vector<std::optional<MapPointId>> points;

  std::vector<OrbDescriptor> Descriptors() const;
};

/// NOT_FOUND: no such frame. DATA_LOSS: its packet does not decode.
StatusOr<FrameView> LoadFrame(MapReader& reader, FrameId frame);

/// What the frame's keyframe looks like, and nothing else of it: much cheaper. Errors as LoadFrame.
StatusOr<std::vector<OrbDescriptor>> LoadDescriptors(MapReader& reader, FrameId frame);

/// f * baseline for stereo, the RGB-D default otherwise: what weighs depths against pixels (pixel metres).
double DepthWeightBf(const Camera& camera);

}  // namespace mapp
