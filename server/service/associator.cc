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
  double depth_m = 0;
  bool by_others = false;
};

/// Points seen before from within this of a camera's ray should be found again.
const float kFoundAgainCosine = std::cos(20.0F * std::numbers::pi_v<float> / 180.0F);

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

  /// Whether the camera should find a point again that it projects.
  bool IsSeenAlike(const LoadedPoint& point) const {
    const Eigen::Vector3f ray = point.p_map - center_;
    return ray.dot(point.view_direction) >= kFoundAgainCosine * ray.norm();
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

/// Adds up how the keyframe's features meet the points of others.
class Comparer {
 public:
  Comparer(const Keyframe& keyframe, const AssociationOptions& options, MapComparison& comparison)
      : keyframe_(keyframe), options_(options), comparison_(comparison) {}

  bool DepthAgrees(size_t feature_idx, double depth_m) const {
    const double error_m = std::abs(DepthOf(feature_idx) - depth_m);
    return error_m <= std::max(options_.max_depth_error_m, options_.max_depth_error_ratio * depth_m);
  }

  /// A feature that has the point's pixel and looks.
  void AddDepth(size_t feature_idx, double depth_m) {
    comparison_.depth_ratios.push_back(DepthOf(feature_idx) / depth_m);
    if (DepthAgrees(feature_idx, depth_m)) ++comparison_.num_confirmed;
  }

  /// A feature that names the point.
  void AddNamed(size_t feature_idx, const ProjectedPoint& projection, double depth_m) {
    const Keypoint& keypoint = keyframe_.features[feature_idx].keypoint;
    const auto reach_px = static_cast<float>(options_.radius_px);
    if (std::abs(keypoint.u_px - projection.u_px) <= reach_px &&
        std::abs(keypoint.v_px - projection.v_px) <= reach_px) {
      AddDepth(feature_idx, depth_m);
    }
  }

 private:
  double DepthOf(size_t feature_idx) const { return keyframe_.features[feature_idx].point->depth_m; }

  const Keyframe& keyframe_;
  const AssociationOptions& options_;
  MapComparison& comparison_;
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

Associations AssociateFeatures(const MapView& view, const Keyframe& keyframe, std::span<const size_t> feature_idxs,
                               std::span<const std::shared_ptr<const LoadedTile>> tiles,
                               const std::unordered_map<MapPointId, size_t>& taken, const AssociationOptions& options) {
  Associations associations;
  const Projector projector(view, options);
  Comparer comparer(keyframe, options, associations.comparison);
  std::vector<ProjectedPoint> projected;
  std::vector<FusionCandidate> candidates;
  for (const auto& tile : tiles) {
    tile->ForEachPoint([&](const LoadedPoint& point) {
      double depth_m = 0;
      const std::optional<ProjectedPoint> projection = projector.Project(point, &depth_m);
      if (!projection) return;
      const bool by_others = tile->IsSeenByOthers(point, keyframe.session);
      if (by_others && projector.IsSeenAlike(point)) ++associations.comparison.num_expected;
      if (const auto named = taken.find(point.id); named != taken.end()) {
        if (by_others) comparer.AddNamed(named->second, *projection, depth_m);
        return;
      }
      if (feature_idxs.empty()) return;
      projected.push_back(*projection);
      candidates.push_back({point.id, depth_m, by_others});
    });
  }

  const FeatureSet set = SelectFeatures(view, keyframe, feature_idxs);
  const MatchOptions match_options{.max_distance = options.max_distance, .max_ratio = options.max_descriptor_ratio};
  for (const Match& match : MatchProjected(projected, set.grid, set.features, match_options)) {
    const FusionCandidate& candidate = candidates[static_cast<size_t>(match.query_idx)];
    const size_t feature_idx = feature_idxs[static_cast<size_t>(match.train_idx)];
    if (candidate.by_others) comparer.AddDepth(feature_idx, candidate.depth_m);
    if (comparer.DepthAgrees(feature_idx, candidate.depth_m)) associations.found.push_back({feature_idx, candidate.id});
  }
  return associations;
}

}  // namespace mapp
