#include "sim/features/feature_camera.h"

#include "sim/features/appearance.h"
#include "sim/features/feature_selection.h"
#include "sim/features/hash.h"
#include "sim/features/observed_surface.h"
#include "sim/features/outlines.h"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <numbers>
#include <utility>

namespace mapp::sim {
namespace {

/// OrbExtractor keeps corners this far from the border of their octave's image.
constexpr double kBorder_px = 19;
/// A line of sight ends this much before its landmark, so that the landmark's own surface does not hide it.
constexpr double kClearance_m = 0.003;
/// Among things there are about so many: growing to them would cost as much as finding them.
constexpr size_t kTypicalCandidates = 12'000;
/// Hash domains.
enum : uint64_t { kViewNoise = 1, kImageNoise, kClutter };

constexpr float kTurn = 2.0F * std::numbers::pi_v<float>;

float Wrap(float angle) {
  const float wrapped = std::fmod(angle, kTurn);
  const float positive = wrapped < 0 ? wrapped + kTurn : wrapped;
  return positive < kTurn ? positive : 0.0F;
}

/// FAST finds corners at whole pixels of their octave's image.
float Round(double pixel, double octave_scale, int size_px) {
  const double rounded = (std::round((pixel + 0.5) / octave_scale - 0.5) + 0.5) * octave_scale - 0.5;
  return static_cast<float>(std::clamp(rounded, 0.0, size_px - 1.0));
}

/// Turns what is in sight into what is measured.
class Sensor {
 public:
  Sensor(const CameraRig& rig, const FeatureNoise& noise, const FeatureView& view)
      : rig_(rig), noise_(noise), view_(view) {}

  ObservedFeature Measure(const FeatureCandidate& candidate, Rng& rng) const {
    ObservedFeature observed;
    observed.landmark = candidate.landmark;
    observed.object_id = candidate.surface->object_id;
    observed.p_world = view_.T_world_camera * candidate.p_camera;
    const auto scale = static_cast<double>(OctaveScale(candidate.octave));
    Keypoint& keypoint = observed.feature.keypoint;
    keypoint.octave = static_cast<uint8_t>(candidate.octave);
    const double sigma_px = noise_.pixel_px * scale;
    keypoint.u_px = Round(candidate.pixel.x() + sigma_px * rng.Normal(), scale, rig_.camera.width_px);
    keypoint.v_px = Round(candidate.pixel.y() + sigma_px * rng.Normal(), scale, rig_.camera.height_px);
    keypoint.angle = Wrap(ImageAngle(candidate, view_) + static_cast<float>(noise_.angle_rad * rng.Normal()));
    observed.feature.descriptor = Describe(candidate, view_, noise_, rng);
    observed.depth_m = MeasureDepth(candidate.p_camera.z(), scale, rng);
    return observed;
  }

  /// A feature that nothing stands behind, at about the depth of a real one.
  ObservedFeature MakeClutter(const ObservedFeature& near, Rng& rng) const {
    constexpr double kSpread_px = 40;
    ObservedFeature clutter;
    Keypoint& keypoint = clutter.feature.keypoint;
    keypoint = near.feature.keypoint;
    keypoint.u_px =
        Inside(static_cast<double>(keypoint.u_px) + rng.Uniform(-kSpread_px, kSpread_px), rig_.camera.width_px);
    keypoint.v_px =
        Inside(static_cast<double>(keypoint.v_px) + rng.Uniform(-kSpread_px, kSpread_px), rig_.camera.height_px);
    keypoint.angle = Wrap(static_cast<float>(rng.Uniform(0, 2 * std::numbers::pi)));
    for (uint64_t& word : clutter.feature.descriptor.words) word = rng.Next();
    clutter.depth_m = near.depth_m;
    return clutter;
  }

 private:
  static float Inside(double pixel, int size_px) {
    return static_cast<float>(std::clamp(pixel, kBorder_px, size_px - 1 - kBorder_px));
  }

  float MeasureDepth(double z_m, double octave_scale, Rng& rng) const {
    const bool missing = rng.Uniform() < noise_.depth_missing_ratio;
    const bool outlier = rng.Uniform() < noise_.depth_outlier_ratio;
    const double normal = rng.Normal();
    const double wrong = outlier ? rng.Uniform(2.0 / 3.0, 4.0 / 3.0) : 1.0;
    if (missing) return 0;
    double measured_m = 0;
    if (rig_.sensor == SensorKind::kRgbd) {
      measured_m = z_m + noise_.depth_sigma_per_m * z_m * z_m * normal;
      if (measured_m > noise_.max_depth_m) return 0;
    } else if (rig_.sensor == SensorKind::kStereo) {
      const double bf_px_m = view_.focal_px * rig_.T_left_right.translation().norm();
      const double disparity_px = bf_px_m / z_m + noise_.disparity_px * octave_scale * normal;
      if (disparity_px <= 0) return 0;
      measured_m = bf_px_m / disparity_px;
    }
    return static_cast<float>(std::max(0.0, measured_m * wrong));
  }

  const CameraRig& rig_;
  const FeatureNoise& noise_;
  const FeatureView& view_;
};

/// What may be seen: the world as it stands, and the people in it.
using Scenes = std::vector<std::shared_ptr<const FeatureScene>>;

std::vector<FeatureCandidate> CandidatesIn(const Scenes& scenes, const FeatureView& view) {
  std::vector<FeatureCandidate> candidates;
  candidates.reserve(kTypicalCandidates);
  for (const auto& scene : scenes) {
    std::vector<bool> seen(scene->num_outline_corners, false);
    for (size_t i = 0; i < scene->surfaces.size(); ++i) {
      const SurfaceSight sight = view.SightOf(scene->bounds[i]);
      if (sight.corners) FindCandidates(scene->surfaces[i], view, kBorder_px, candidates);
      if (sight.outline) FindOutlineCandidates(scene->surfaces[i], view, kBorder_px, seen, candidates);
    }
  }
  return candidates;
}

std::vector<uint8_t> Hidden(const Scenes& scenes, const FeatureView& view,
                            const std::vector<FeatureCandidate>& candidates, std::span<const size_t> indices) {
  std::vector<Eigen::Vector3d> p_world;
  p_world.reserve(indices.size());
  const Eigen::Matrix3d R_world_camera = view.R_camera_world.transpose();
  const Eigen::Vector3d& eye_world = view.T_world_camera.translation();
  for (const size_t i : indices) p_world.push_back(R_world_camera * candidates[i].p_camera + eye_world);
  std::vector<uint8_t> hidden(indices.size(), 0);
  for (const auto& scene : scenes) {
    const auto by_scene = scene->rays->Occluded(eye_world, p_world, kClearance_m);
    for (size_t i = 0; i < hidden.size(); ++i) hidden[i] |= by_scene[i];
  }
  return hidden;
}

/// In (-1, 1), of variance 1/6: the sum of two uniform numbers.
double Triangular(uint64_t hash) {
  return static_cast<double>(hash >> 32) * 0x1.0p-32 + static_cast<double>(hash & 0xffffffffU) * 0x1.0p-32 - 1;
}

/// A corner's contrast differs from view to view, for a good part in the same way in views of one kind.
std::vector<double> ScoresOf(const std::vector<FeatureCandidate>& candidates, const FeatureNoise& noise,
                             uint64_t image_seed) {
  std::vector<double> scores;
  scores.reserve(candidates.size());
  for (const FeatureCandidate& candidate : candidates) {
    const auto view_bin = static_cast<uint64_t>(candidate.octave * 64 + std::lround(8 * candidate.view_cosine));
    const double of_view = Triangular(Hash(candidate.landmark, kViewNoise, view_bin));
    const double of_image = Triangular(Hash(candidate.landmark, image_seed));
    const double share =
        1 + std::sqrt(6.0) * (noise.view_response_ratio * of_view + noise.image_response_ratio * of_image);
    scores.push_back(candidate.response * std::max(share, 0.0));
  }
  return scores;
}

bool InUnit(double value) { return value >= 0 && value <= 1; }

}  // namespace

Status FeatureNoise::Validate() const {
  if (num_features < 1 || num_features > kMaxFeatures) {
    return absl::InvalidArgumentError(
        fmt::format("num_features: must be in [1, {}], got {}", kMaxFeatures, num_features));
  }
  const std::pair<const char*, double> sizes[] = {{"pixel_px", pixel_px},
                                                  {"angle_rad", angle_rad},
                                                  {"view_response_ratio", view_response_ratio},
                                                  {"image_response_ratio", image_response_ratio},
                                                  {"random_bits", random_bits},
                                                  {"view_bits", view_bits},
                                                  {"scale_bits", scale_bits},
                                                  {"depth_sigma_per_m", depth_sigma_per_m},
                                                  {"max_depth_m", max_depth_m},
                                                  {"disparity_px", disparity_px}};
  for (const auto& [name, value] : sizes) {
    if (!(value >= 0) || !std::isfinite(value)) {
      return absl::InvalidArgumentError(fmt::format("{}: must be a number of at least 0, got {}", name, value));
    }
  }
  const std::pair<const char*, double> ratios[] = {{"clutter_ratio", clutter_ratio},
                                                   {"depth_missing_ratio", depth_missing_ratio},
                                                   {"depth_outlier_ratio", depth_outlier_ratio}};
  for (const auto& [name, value] : ratios) {
    if (!InUnit(value)) return absl::InvalidArgumentError(fmt::format("{}: must be in [0, 1], got {}", name, value));
  }
  return absl::OkStatus();
}

StatusOr<std::unique_ptr<FeatureCamera>> FeatureCamera::Create(std::shared_ptr<const FeatureWorld> world,
                                                               const CameraRig& rig, const FeatureNoise& noise,
                                                               uint64_t seed) {
  MAPP_RETURN_IF_ERROR(Annotate(rig.camera.Validate(), "camera"));
  MAPP_RETURN_IF_ERROR(noise.Validate());
  return std::unique_ptr<FeatureCamera>(new FeatureCamera(std::move(world), rig, noise, seed));
}

std::vector<ObservedFeature> FeatureCamera::Observe(const Pose3& T_world_camera, int64_t stamp_ns) const {
  Scenes scenes = {world_->At(stamp_ns)};
  if (auto passers = world_->PassersAt(stamp_ns)) scenes.push_back(std::move(passers));
  const FeatureView view(rig_.camera, T_world_camera);
  const uint64_t image_seed = Hash(seed_, static_cast<uint64_t>(stamp_ns), kImageNoise);
  const std::vector<FeatureCandidate> candidates = CandidatesIn(scenes, view);
  const std::vector<double> scores = ScoresOf(candidates, noise_, image_seed);
  const HiddenTest hidden = [&](std::span<const size_t> indices) { return Hidden(scenes, view, candidates, indices); };
  const int num_clutter = static_cast<int>(std::lround(noise_.clutter_ratio * noise_.num_features));
  const std::vector<size_t> selected =
      SelectFeatures(rig_.camera, candidates, scores, noise_.num_features - num_clutter, hidden);

  const Sensor sensor(rig_, noise_, view);
  std::vector<ObservedFeature> features;
  features.reserve(static_cast<size_t>(noise_.num_features));
  for (const size_t i : selected) {
    Rng rng(Hash(candidates[i].landmark, image_seed, kClutter));
    features.push_back(sensor.Measure(candidates[i], rng));
  }
  // An image of little contrast has little clutter, too.
  Rng rng(Hash(image_seed, kClutter));
  const auto wanted = static_cast<size_t>(std::lround(noise_.clutter_ratio * static_cast<double>(features.size())));
  const size_t num_real = features.size();
  for (size_t i = 0; i < wanted; ++i) {
    features.push_back(sensor.MakeClutter(features[rng.Below(num_real)], rng));
  }
  return features;
}

}  // namespace mapp::sim
