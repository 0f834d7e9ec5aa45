#include "redundancy_control.h"

#include "mapp/base/check.h"

#include <algorithm>
#include <utility>

namespace mapp {
namespace {

const PointReference& PointOf(const Keyframe& keyframe, size_t feature_idx) {
  return *keyframe.features[feature_idx].point;
}

double MeanObservations(const Keyframe& keyframe, const OwnPoints& own) {
  double sum = 0;
  for (const size_t idx : own.feature_idx) sum += PointOf(keyframe, idx).num_observations;
  return own.feature_idx.empty() ? 0 : sum / static_cast<double>(own.feature_idx.size());
}

/// Positions in `own` of the redundant points, and those among them that are observed more often than average.
struct Redundant {
  std::vector<size_t> all;
  std::vector<size_t> often;
};

Redundant FindRedundant(const Keyframe& whole, const OwnPoints& own, const std::vector<bool>& redundant) {
  const double mean = MeanObservations(whole, own);
  Redundant found;
  for (size_t i = 0; i < own.feature_idx.size(); ++i) {
    if (!redundant[i]) continue;
    found.all.push_back(i);
    if (PointOf(whole, own.feature_idx[i]).num_observations > mean) found.often.push_back(i);
  }
  return found;
}

/// `count` of `items`, every subset equally likely (Fisher-Yates, cut short).
std::vector<size_t> Choose(std::vector<size_t> items, size_t count, Rng& rng) {
  for (size_t i = 0; i < count; ++i) std::swap(items[i], items[i + rng.Below(items.size() - i)]);
  items.resize(count);
  return items;
}

std::vector<size_t> Injected(const Redundant& redundant, Injection injection, Rng& rng) {
  switch (injection) {
    case Injection::kOften:
      return redundant.often;
    case Injection::kNone:
      return {};
    case Injection::kRandom:
      return Choose(redundant.all, redundant.often.size(), rng);
  }
  return {};
}

}  // namespace

OwnPoints OwnPointsOf(const Keyframe& keyframe, const Camera& camera) {
  OwnPoints own;
  for (size_t i = 0; i < keyframe.features.size(); ++i) {
    const KeyframeFeature& feature = keyframe.features[i];
    if (!feature.point) continue;
    const Eigen::Vector2d pixel(feature.keypoint.u_px, feature.keypoint.v_px);
    own.p_camera.emplace_back(feature.point->depth_m * camera.Unproject(pixel));
    own.feature_idx.push_back(i);
  }
  return own;
}

Reduced RemoveRedundant(const Keyframe& whole, const OwnPoints& own, const std::vector<bool>& redundant,
                        Injection injection, Rng& rng) {
  MAPP_CHECK(redundant.size() == own.feature_idx.size());
  std::vector<bool> keep(redundant.size());
  for (size_t i = 0; i < keep.size(); ++i) keep[i] = !redundant[i];
  Reduced reduced;
  reduced.num_fresh = static_cast<size_t>(std::count(keep.begin(), keep.end(), true));
  for (const size_t i : Injected(FindRedundant(whole, own, redundant), injection, rng)) keep[i] = true;

  Keyframe& partial = reduced.keyframe;
  partial.session = whole.session;
  partial.number = whole.number;
  partial.stamp_ns = whole.stamp_ns;
  partial.pose_frame = whole.pose_frame;
  partial.T_frame_camera = whole.T_frame_camera;
  partial.partial = true;
  partial.overlap = whole.overlap;
  partial.raster = whole.raster;
  for (size_t i = 0; i < keep.size(); ++i) {
    if (keep[i]) partial.features.push_back(whole.features[own.feature_idx[i]]);
  }
  return reduced;
}

}  // namespace mapp
