#include "eval/trajectory_metrics.h"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <cstdlib>

namespace mapp {
namespace {

constexpr int kMinPairs = 3;  // fewer leave a rigid motion undetermined

/// Columns of both are positions of the same moments, metres.
struct PairedPositions {
  Eigen::Matrix3Xd truth;
  Eigen::Matrix3Xd estimate;
};

/// The pose of `truth` (by time, not empty) nearest to `stamp_ns`; the earlier of two equally near ones.
const StampedPose& NearestPose(const std::vector<StampedPose>& truth, int64_t stamp_ns) {
  const auto after = std::ranges::lower_bound(truth, stamp_ns, {}, &StampedPose::stamp_ns);
  if (after == truth.begin()) return truth.front();
  if (after == truth.end()) return truth.back();
  const auto before = after - 1;
  return stamp_ns - before->stamp_ns <= after->stamp_ns - stamp_ns ? *before : *after;
}

StatusOr<PairedPositions> Pair(std::vector<StampedPose> truth, const std::vector<StampedPose>& estimate,
                               double max_dt_s) {
  std::ranges::sort(truth, {}, &StampedPose::stamp_ns);
  const auto max_dt_ns = std::llround(max_dt_s * 1e9);
  const auto capacity = static_cast<Eigen::Index>(truth.empty() ? 0 : estimate.size());
  PairedPositions pairs{Eigen::Matrix3Xd(3, capacity), Eigen::Matrix3Xd(3, capacity)};
  Eigen::Index num_pairs = 0;
  for (Eigen::Index i = 0; i < capacity; ++i) {
    const StampedPose& pose = estimate[static_cast<size_t>(i)];
    const StampedPose& nearest = NearestPose(truth, pose.stamp_ns);
    if (std::abs(nearest.stamp_ns - pose.stamp_ns) > max_dt_ns) continue;
    pairs.truth.col(num_pairs) = nearest.T_world_camera.translation();
    pairs.estimate.col(num_pairs) = pose.T_world_camera.translation();
    ++num_pairs;
  }
  if (num_pairs < kMinPairs) {
    return absl::InvalidArgumentError(
        fmt::format("estimate: {} of {} poses are within {} s of a true one; at least {} are needed", num_pairs,
                    estimate.size(), max_dt_s, kMinPairs));
  }
  pairs.truth.conservativeResize(3, num_pairs);
  pairs.estimate.conservativeResize(3, num_pairs);
  return pairs;
}

TrajectoryError Measure(const Sim3& T_truth_estimate, const PairedPositions& pairs) {
  TrajectoryError error;
  error.T_truth_estimate = T_truth_estimate;
  error.num_paired = static_cast<size_t>(pairs.truth.cols());
  double sum_m = 0;
  double sum_squares_m2 = 0;
  for (Eigen::Index i = 0; i < pairs.truth.cols(); ++i) {
    const double distance_m = (T_truth_estimate * Eigen::Vector3d(pairs.estimate.col(i)) - pairs.truth.col(i)).norm();
    sum_m += distance_m;
    sum_squares_m2 += distance_m * distance_m;
    error.max_m = std::max(error.max_m, distance_m);
  }
  const auto num_pairs = static_cast<double>(pairs.truth.cols());
  error.mean_m = sum_m / num_pairs;
  error.rmse_m = std::sqrt(sum_squares_m2 / num_pairs);
  return error;
}

}  // namespace

StatusOr<TrajectoryError> AbsoluteTrajectoryError(const std::vector<StampedPose>& truth,
                                                  const std::vector<StampedPose>& estimate, bool with_scale,
                                                  double max_dt_s) {
  MAPP_ASSIGN_OR_RETURN(const PairedPositions pairs, Pair(truth, estimate, max_dt_s));
  return Measure(AlignPoints(pairs.estimate, pairs.truth, with_scale), pairs);
}

StatusOr<TrajectoryError> TrajectoryErrorUnder(const Sim3& T_truth_estimate, const std::vector<StampedPose>& truth,
                                               const std::vector<StampedPose>& estimate, double max_dt_s) {
  MAPP_ASSIGN_OR_RETURN(const PairedPositions pairs, Pair(truth, estimate, max_dt_s));
  return Measure(T_truth_estimate, pairs);
}

}  // namespace mapp
