#include "server/service/associator.h"

#include "server/service/frame_view.h"
#include "vision/matching.h"

#include <algorithm>
#include <cmath>
#include <numbers>
#include <optional>

namespace mapp {
namespace {

/// A map point in front of the camera.
struct FusionCandidate {
  MapPointId id;
  double depth_m;
};

/// Projects map points into the keyframe's image as the camera recorded it.
class Projector {
 public:
  Projector(const MapView& view, const AssociationOptions& options)
      : camera_(view.camera),
        pinhole_(view.camera.Undistorted()),
        focal_px_(view.camera.MeanFocalPx()),
        T_camera_map_(view.T_map_camera.Inverse()),
        center_(view.T_map_camera.translation().cast<float>()),
        cos_max_angle_(static_cast<float>(std::cos(options.max_view_angle_deg * std::numbers::pi / 180))),
        radius_px_(static_cast<float>(options.radius_px)) {}

  std::optional<ProjectedPoint> Project(const LoadedPoint& point, double* depth_m) const {
    const Eigen::Vector3f ray = point.p_map - center_;
    const float distance_m = ray.norm();
    if (ray.dot(point.view_direction) < cos_max_angle_ * distance_m) return std::nullopt;
    const Eigen::Vector3d p_camera = T_camera_map_ * point.p_map.cast<double>();
    if (p_camera.z() < kMinDepthM || !NearImage(pinhole_.Project(p_camera))) return std::nullopt;
    const Eigen::Vector2d pixel = camera_.Project(p_camera);
    if (!camera_.Contains(pixel)) return std::nullopt;
    *depth_m = p_camera.z();
    return ProjectedPoint{static_cast<float>(pixel.x()), static_cast<float>(pixel.y()), radius_px_,
                          PredictOctave(ReferenceFor(focal_px_, point.reference_distance_m), distance_m),
                          point.descriptor};
  }

 private:
  /// Radial distortion folds far rays back into the image: only rays near the undistorted image are distorted.
  bool NearImage(const Eigen::Vector2d& undistorted_px) const {
    return camera_.Contains(undistorted_px, -0.25 * std::max(camera_.width_px, camera_.height_px));
  }

  const Camera& camera_;
  PinholeCamera pinhole_;
  double focal_px_;
  Pose3 T_camera_map_;
  Eigen::Vector3f center_;
  float cos_max_angle_;
  float radius_px_;
};

struct FeatureSet {
  std::vector<Feature> features;
  FeatureGrid grid;
};

FeatureSet SelectFeatures(const MapView& view, const Keyframe& keyframe, std::span<const size_t> feature_idxs) {
  FeatureSet set;
  std::vector<FeatureGrid::Point> pixels;
  for (const size_t idx : feature_idxs) {
    const KeyframeFeature& feature = keyframe.features[idx];
    set.features.push_back({feature.keypoint, feature.descriptor});
    pixels.push_back({feature.keypoint.u_px, feature.keypoint.v_px});
  }
  set.grid = FeatureGrid(pixels, view.camera.width_px, view.camera.height_px);
  return set;
}

}  // namespace

std::vector<Association> AssociateFeatures(const MapView& view, const Keyframe& keyframe,
                                           std::span<const size_t> feature_idxs,
                                           std::span<const std::shared_ptr<const LoadedTile>> tiles,
                                           const std::unordered_set<MapPointId>& taken,
                                           const AssociationOptions& options) {
  if (feature_idxs.empty()) return {};
  const Projector projector(view, options);
  std::vector<ProjectedPoint> projected;
  std::vector<FusionCandidate> candidates;
  for (const auto& tile : tiles) {
    tile->ForEachPoint([&](const LoadedPoint& point) {
      double depth_m = 0;
      const std::optional<ProjectedPoint> projection = projector.Project(point, &depth_m);
      if (!projection || taken.contains(point.id)) return;
      projected.push_back(*projection);
      candidates.push_back({point.id, depth_m});
    });
  }

  const FeatureSet set = SelectFeatures(view, keyframe, feature_idxs);
  const MatchOptions match_options{.max_distance = options.max_distance, .max_ratio = options.max_descriptor_ratio};
  std::vector<Association> associations;
  for (const Match& match : MatchProjected(projected, set.grid, set.features, match_options)) {
    const FusionCandidate& candidate = candidates[static_cast<size_t>(match.query_idx)];
    const size_t feature_idx = feature_idxs[static_cast<size_t>(match.train_idx)];
    const double error_m = std::abs(keyframe.features[feature_idx].point->depth_m - candidate.depth_m);
    const double allowed_m = std::max(options.max_depth_error_m, options.max_depth_error_ratio * candidate.depth_m);
    if (error_m <= allowed_m) associations.push_back({feature_idx, candidate.id});
  }
  return associations;
}

}  // namespace mapp
