#include "eval/metrics/trajectory_metrics.h"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <cstdlib>

namespace mapp {
namespace {

constexpr size_t kMinPairs = 3;  // fewer leave a rigid motion undetermined
constexpr double kRounding = 1e-9;
constexpr double kDeltaTolerance = 0.1;  // a relative pose may span this share more or less than asked

/// Poses of the same moment.
struct PosePair {
  int64_t stamp_ns = 0;  ///< of the estimate
  Pose3 T_truth_camera;
  Pose3 T_estimate_camera;
};

/// The pose of `truth` (by time, not empty) nearest to `stamp_ns`; the earlier of two equally near ones.
const StampedPose& NearestPose(const std::vector<StampedPose>& truth, int64_t stamp_ns) {
  const auto after = std::ranges::lower_bound(truth, stamp_ns, {}, &StampedPose::stamp_ns);
  if (after == truth.begin()) return truth.front();
  if (after == truth.end()) return truth.back();
  const auto before = after - 1;
  return stamp_ns - before->stamp_ns <= after->stamp_ns - stamp_ns ? *before : *after;
}

/// By time of the estimate.
StatusOr<std::vector<PosePair>> Pair(std::vector<StampedPose> truth, const std::vector<StampedPose>& estimate,
                                     double max_dt_s) {
  std::ranges::sort(truth, {}, &StampedPose::stamp_ns);
  const auto max_dt_ns = std::llround(max_dt_s * 1e9);
  std::vector<PosePair> pairs;
  for (const StampedPose& pose : estimate) {
    if (truth.empty()) break;
    const StampedPose& nearest = NearestPose(truth, pose.stamp_ns);
    if (std::abs(nearest.stamp_ns - pose.stamp_ns) > max_dt_ns) continue;
    pairs.push_back({pose.stamp_ns, nearest.T_world_camera, pose.T_world_camera});
  }
  if (pairs.size() < kMinPairs) {
    return absl::InvalidArgumentError(
        fmt::format("estimate: {} of {} poses are within {} s of a true one; at least {} are needed", pairs.size(),
                    estimate.size(), max_dt_s, kMinPairs));
  }
  std::ranges::sort(pairs, {}, &PosePair::stamp_ns);
  return pairs;
}

Sim3 Align(const std::vector<PosePair>& pairs, bool with_scale) {
  const auto num_pairs = static_cast<Eigen::Index>(pairs.size());
  Eigen::Matrix3Xd p_truth(3, num_pairs);
  Eigen::Matrix3Xd p_estimate(3, num_pairs);
  for (Eigen::Index i = 0; i < num_pairs; ++i) {
    const PosePair& pair = pairs[static_cast<size_t>(i)];
    p_truth.col(i) = pair.T_truth_camera.translation();
    p_estimate.col(i) = pair.T_estimate_camera.translation();
  }
  return AlignPoints(p_estimate, p_truth, with_scale);
}

TrajectoryError Measure(const Sim3& T_truth_estimate, const std::vector<PosePair>& pairs) {
  std::vector<double> distances_m;
  distances_m.reserve(pairs.size());
  for (const PosePair& pair : pairs) {
    const Eigen::Vector3d p_truth = T_truth_estimate * pair.T_estimate_camera.translation();
    distances_m.push_back((p_truth - pair.T_truth_camera.translation()).norm());
  }
  const Summary summary = Summarize(distances_m);
  return {summary.rms, summary.mean, summary.median, summary.max, summary.count, T_truth_estimate};
}

/// For each pair, where it stands on the axis along which relative poses are taken: seconds, or metres of true path.
/// Does not decrease.
std::vector<double> TimesOf(const std::vector<PosePair>& pairs) {
  std::vector<double> times_s;
  for (const PosePair& pair : pairs) times_s.push_back(static_cast<double>(pair.stamp_ns - pairs[0].stamp_ns) * 1e-9);
  return times_s;
}

std::vector<double> PathLengthsOf(const std::vector<PosePair>& pairs) {
  std::vector<double> lengths_m{0};
  for (size_t i = 1; i < pairs.size(); ++i) {
    lengths_m.push_back(lengths_m.back() + Distance(pairs[i - 1].T_truth_camera, pairs[i].T_truth_camera));
  }
  return lengths_m;
}

/// Index of the position after `from` that is nearest to `delta` beyond it; absent when none is near enough.
std::optional<size_t> PartnerOf(const std::vector<double>& positions, size_t from, double delta) {
  const double target = positions[from] + delta;
  if (target > positions.back() + kRounding) return std::nullopt;  // else the end would add pairs that are too short
  const auto first = positions.begin() + static_cast<std::ptrdiff_t>(from) + 1;
  auto partner = std::lower_bound(first, positions.end(), target);
  if (partner == positions.end() || (partner != first && target - *(partner - 1) <= *partner - target)) --partner;
  if (partner < first) return std::nullopt;
  if (std::abs(*partner - target) > kDeltaTolerance * delta) return std::nullopt;
  return static_cast<size_t>(partner - positions.begin());
}

StatusOr<RelativePoseError> MeasureRelative(const std::vector<PosePair>& pairs, const std::vector<double>& positions,
                                            double delta, const char* unit) {
  if (!(delta > 0) || !std::isfinite(delta)) {
    return absl::InvalidArgumentError(fmt::format("delta: must be above 0 {}, got {}", unit, delta));
  }
  std::vector<double> translations_m;
  std::vector<double> rotations_rad;
  for (size_t i = 0; i < pairs.size(); ++i) {
    const std::optional<size_t> j = PartnerOf(positions, i, delta);
    if (!j) continue;
    const Pose3 true_motion = pairs[i].T_truth_camera.Inverse() * pairs[*j].T_truth_camera;
    const Pose3 motion = pairs[i].T_estimate_camera.Inverse() * pairs[*j].T_estimate_camera;
    const Pose3 error = true_motion.Inverse() * motion;
    translations_m.push_back(error.translation().norm());
    rotations_rad.push_back(RotationAngle(Pose3(), error));
  }
  if (translations_m.empty()) {
    return absl::InvalidArgumentError(
        fmt::format("delta: no two of {} poses are {} {} apart", pairs.size(), delta, unit));
  }
  return RelativePoseError{Summarize(translations_m), Summarize(rotations_rad)};
}

}  // namespace

StatusOr<TrajectoryError> AbsoluteTrajectoryError(const std::vector<StampedPose>& truth,
                                                  const std::vector<StampedPose>& estimate, bool with_scale,
                                                  double max_dt_s) {
  MAPP_ASSIGN_OR_RETURN(const std::vector<PosePair> pairs, Pair(truth, estimate, max_dt_s));
  return Measure(Align(pairs, with_scale), pairs);
}

StatusOr<TrajectoryError> TrajectoryErrorUnder(const Sim3& T_truth_estimate, const std::vector<StampedPose>& truth,
                                               const std::vector<StampedPose>& estimate, double max_dt_s) {
  MAPP_ASSIGN_OR_RETURN(const std::vector<PosePair> pairs, Pair(truth, estimate, max_dt_s));
  return Measure(T_truth_estimate, pairs);
}

StatusOr<TrajectoryError> TogetherTrajectoryError(const std::vector<JudgedTrajectory>& trajectories, double max_dt_s) {
  std::vector<PosePair> together;
  for (const JudgedTrajectory& one : trajectories) {
    MAPP_ASSIGN_OR_RETURN(const std::vector<PosePair> pairs, Pair(one.truth, one.estimate, max_dt_s));
    together.insert(together.end(), pairs.begin(), pairs.end());
  }
  if (together.empty()) return absl::InvalidArgumentError("trajectories: none is given");
  return Measure(Align(together, /*with_scale=*/false), together);
}

StatusOr<double> ScaleError(const std::vector<StampedPose>& truth, const std::vector<StampedPose>& estimate,
                            double max_dt_s) {
  MAPP_ASSIGN_OR_RETURN(const std::vector<PosePair> pairs, Pair(truth, estimate, max_dt_s));
  const Eigen::Vector3d first = pairs[0].T_estimate_camera.translation();
  const bool moved =
      std::ranges::any_of(pairs, [&](const PosePair& pair) { return pair.T_estimate_camera.translation() != first; });
  const double true_per_estimated = moved ? Align(pairs, /*with_scale=*/true).scale : 0;
  if (!std::isfinite(true_per_estimated) || true_per_estimated <= 0) {
    return absl::InvalidArgumentError(
        fmt::format("estimate: its {} paired positions leave the scale undetermined", pairs.size()));
  }
  return 1 / true_per_estimated - 1;
}

StatusOr<RelativePoseError> RelativePoseErrorOverTime(const std::vector<StampedPose>& truth,
                                                      const std::vector<StampedPose>& estimate, double delta_s,
                                                      double max_dt_s) {
  MAPP_ASSIGN_OR_RETURN(const std::vector<PosePair> pairs, Pair(truth, estimate, max_dt_s));
  return MeasureRelative(pairs, TimesOf(pairs), delta_s, "s");
}

StatusOr<RelativePoseError> RelativePoseErrorOverDistance(const std::vector<StampedPose>& truth,
                                                          const std::vector<StampedPose>& estimate, double delta_m,
                                                          double max_dt_s) {
  MAPP_ASSIGN_OR_RETURN(const std::vector<PosePair> pairs, Pair(truth, estimate, max_dt_s));
  return MeasureRelative(pairs, PathLengthsOf(pairs), delta_m, "m");
}

}  // namespace mapp
