#include "server/service/keyframe_evidence.h"

#include "server/service/median.h"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>

namespace mapp {
namespace {

bool IsAstray(const Keyframe& keyframe, const Camera& camera, const Pose3& T_camera_frame, const KnownPoint& known,
              const EvidenceOptions& options) {
  const KeyframeFeature& feature = keyframe.features[known.feature_idx];
  const Eigen::Vector3d p_camera = T_camera_frame * known.point->position;
  if (p_camera.z() <= 0) return true;
  const double depth_m = feature.point->depth_m;
  if (std::abs(p_camera.z() - depth_m) > std::max(options.max_depth_off_m, options.max_depth_off_ratio * depth_m)) {
    return true;
  }
  // Along the feature's ray at the point's depth: no distortion has to be applied to a ray far outside the image.
  const Eigen::Vector3d p_seen = p_camera.z() * camera.Unproject({feature.keypoint.u_px, feature.keypoint.v_px});
  return (p_camera - p_seen).norm() > std::max(options.max_aside_m, options.max_aside_ratio * p_camera.z());
}

}  // namespace

bool IsFalse(Finding finding) { return finding >= Finding::kBadDepths && finding < Finding::kUnlike; }

const char* FindingName(Finding finding) {
  switch (finding) {
    case Finding::kSilent:
      return "silent";
    case Finding::kConsistent:
      return "consistent";
    case Finding::kAgrees:
      return "agrees";
    case Finding::kDoubtful:
      return "doubtful";
    case Finding::kBadDepths:
      return "bad-depths";
    case Finding::kOwnPoints:
      return "own-points";
    case Finding::kOwnDescriptors:
      return "own-descriptors";
    case Finding::kMapDepths:
      return "map-depths";
    case Finding::kElsewhere:
      return "elsewhere";
    case Finding::kUnlike:
      return "unlike";
  }
  return "unknown";
}

KeyframeEvidence JudgeDepths(const Keyframe& keyframe, SensorKind sensor, const EvidenceOptions& options) {
  if (sensor != SensorKind::kRgbd && sensor != SensorKind::kStereo) return {};
  std::vector<double> depths_m;
  for (const KeyframeFeature& feature : keyframe.features) {
    if (feature.point) depths_m.push_back(feature.point->depth_m);
  }
  if (depths_m.size() < static_cast<size_t>(options.min_points)) return {};
  const double median_m = Median(std::move(depths_m));
  if (median_m >= options.min_median_depth_m && median_m <= options.max_median_depth_m) return {};
  return {Finding::kBadDepths, fmt::format("the median depth of its points is {:.4g} m", median_m)};
}

KeyframeEvidence JudgeKnownPoints(const Keyframe& keyframe, const Camera& camera, const Pose3& T_frame_camera,
                                  std::span<const KnownPoint> known, const EvidenceOptions& options) {
  if (known.size() < static_cast<size_t>(options.min_points)) return {};
  const Pose3 T_camera_frame = T_frame_camera.Inverse();
  const auto num_astray = std::ranges::count_if(
      known, [&](const KnownPoint& point) { return IsAstray(keyframe, camera, T_camera_frame, point, options); });
  const auto num_unlike = std::ranges::count_if(known, [&](const KnownPoint& point) {
    return HammingDistance(keyframe.features[point.feature_idx].descriptor, point.point->descriptor) >
           options.unlike_distance;
  });
  const double too_many = options.max_bad_ratio * static_cast<double>(known.size());
  if (static_cast<double>(num_astray) > too_many) {
    return {Finding::kOwnPoints,
            fmt::format("{} of the {} known points it names are not where it sees them", num_astray, known.size())};
  }
  if (static_cast<double>(num_unlike) > too_many) {
    return {Finding::kOwnDescriptors,
            fmt::format("{} of the {} known points it names look different", num_unlike, known.size())};
  }
  return {Finding::kConsistent, {}};
}

KeyframeEvidence JudgeComparison(const MapComparison& comparison, const EvidenceOptions& options) {
  const std::vector<double>& ratios = comparison.depth_ratios;
  // Noise, however large, goes both ways.
  const double least_off = 1 + options.depth_tolerance;
  const auto num_off = std::max(std::ranges::count_if(ratios, [&](double ratio) { return ratio > least_off; }),
                                std::ranges::count_if(ratios, [&](double ratio) { return ratio < 1 / least_off; }));
  if (num_off >= options.min_points &&
      static_cast<double>(num_off) > options.min_depths_off * static_cast<double>(ratios.size())) {
    return {Finding::kMapDepths,
            fmt::format("{} of the {} points of the map that it sees have another depth, {:.4g} times the map's in the "
                        "median",
                        num_off, ratios.size(), Median(ratios))};
  }
  if (comparison.num_confirmed >= options.min_confirmed) return {Finding::kAgrees, {}};
  if (comparison.num_expected < options.min_expected) return {};
  return {Finding::kDoubtful, {}};
}

}  // namespace mapp
