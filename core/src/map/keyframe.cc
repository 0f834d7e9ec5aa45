#include "mapp/map/keyframe.h"

#include <fmt/format.h>

#include <cmath>

namespace mapp {
namespace {

Status ValidateFeature(const KeyframeFeature& feature, size_t idx, const Camera& camera, int num_levels) {
  const Keypoint& keypoint = feature.keypoint;
  const Eigen::Vector2d pixel(keypoint.u_px, keypoint.v_px);
  if (!pixel.allFinite() || !camera.Contains(pixel)) {
    return absl::InvalidArgumentError(fmt::format("keyframe.features[{}].pixel: ({}, {}) is outside the {} x {} image",
                                                  idx, keypoint.u_px, keypoint.v_px, camera.width_px,
                                                  camera.height_px));
  }
  if (keypoint.octave >= num_levels) {
    return absl::InvalidArgumentError(
        fmt::format("keyframe.features[{}].octave: must be below num_levels {} of the feature settings, got {}", idx,
                    num_levels, keypoint.octave));
  }
  if (!std::isfinite(keypoint.angle)) {
    return absl::InvalidArgumentError(fmt::format("keyframe.features[{}].angle: must be finite", idx));
  }
  if (!feature.point) return absl::OkStatus();
  if (!(feature.point->depth_m > 0 && feature.point->depth_m < kMaxPointDepthM)) {
    return absl::InvalidArgumentError(fmt::format("keyframe.features[{}].depth_m: must be in (0, {}), got {}", idx,
                                                  kMaxPointDepthM, feature.point->depth_m));
  }
  if (feature.point->num_observations == 0) {
    return absl::InvalidArgumentError(fmt::format("keyframe.features[{}].num_observations: must be at least 1", idx));
  }
  return absl::OkStatus();
}

}  // namespace

DepthRaster RasterOf(const Keyframe& keyframe, const Camera& camera) {
  DepthRasterizer rasterizer(camera);
  for (const KeyframeFeature& feature : keyframe.features) {
    if (feature.point) rasterizer.Add({feature.keypoint.u_px, feature.keypoint.v_px}, feature.point->depth_m);
  }
  return rasterizer.Finish();
}

Status Validate(const Keyframe& keyframe, const Camera& camera, const FeatureSettings& features) {
  if (!keyframe.T_frame_camera.IsFinite()) return absl::InvalidArgumentError("keyframe.pose: must be finite");
  const double farthest = keyframe.T_frame_camera.translation().cwiseAbs().maxCoeff();
  if (farthest > kMaxCoordinateM) {
    return absl::InvalidArgumentError(
        fmt::format("keyframe.pose: coordinates must be within {} m, got {}", kMaxCoordinateM, farthest));
  }
  if (keyframe.overlap && !(*keyframe.overlap >= 0 && *keyframe.overlap <= 1)) {
    return absl::InvalidArgumentError(fmt::format("keyframe.overlap: must be in [0, 1], got {}", *keyframe.overlap));
  }
  if (keyframe.features.size() > static_cast<size_t>(kMaxFeatures)) {
    return absl::InvalidArgumentError(
        fmt::format("keyframe.features: at most {}, got {}", kMaxFeatures, keyframe.features.size()));
  }
  for (size_t i = 0; i < keyframe.features.size(); ++i) {
    MAPP_RETURN_IF_ERROR(ValidateFeature(keyframe.features[i], i, camera, features.num_levels));
  }
  if (keyframe.raster) MAPP_RETURN_IF_ERROR(Validate(*keyframe.raster, camera));
  return absl::OkStatus();
}

}  // namespace mapp
