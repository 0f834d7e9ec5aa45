#pragma once

#include "datasets/sequence.h"
#include "eval/metrics/statistics.h"
#include "mapp/base/status.h"

#include <vector>

namespace mapp {

/// Both errors pair each estimated pose with the nearest true one, the earlier of two equally near, and leave out those
/// that have none within this time.
inline constexpr double kDefaultMaxPairingS = 0.02;

struct TrajectoryError {
  double rmse_m = 0;
  double mean_m = 0;
  double median_m = 0;
  double max_m = 0;
  size_t num_paired = 0;
  Sim3 T_truth_estimate;  ///< the alignment used
};

/// Absolute trajectory error: each estimated pose paired with the nearest true time within `max_dt_s`, aligned by
/// Umeyama (SE3, or Sim3 `with_scale`), RMSE of positions. INVALID_ARGUMENT below 3 pairs.
StatusOr<TrajectoryError> AbsoluteTrajectoryError(const std::vector<StampedPose>& truth,
                                                  const std::vector<StampedPose>& estimate, bool with_scale,
                                                  double max_dt_s = kDefaultMaxPairingS);
/// The same under an alignment found elsewhere: how a merged map is judged.
StatusOr<TrajectoryError> TrajectoryErrorUnder(const Sim3& T_truth_estimate, const std::vector<StampedPose>& truth,
                                               const std::vector<StampedPose>& estimate,
                                               double max_dt_s = kDefaultMaxPairingS);

/// A trajectory with its truth.
struct JudgedTrajectory {
  std::vector<StampedPose> truth;
  std::vector<StampedPose> estimate;
};
/// The same of several that claim to be in one frame, all under the one rigid alignment that suits them together best.
/// Their clocks are their own. INVALID_ARGUMENT: none, or one with fewer than 3 pairs.
StatusOr<TrajectoryError> TogetherTrajectoryError(const std::vector<JudgedTrajectory>& trajectories,
                                                  double max_dt_s = kDefaultMaxPairingS);

/// How much longer than the truth the estimate is: 0.01 = lengths come out 1 % too long. From the Sim3 alignment, so
/// noise alone leaves it near 0. INVALID_ARGUMENT below 3 pairs, or when all estimated positions coincide.
StatusOr<double> ScaleError(const std::vector<StampedPose>& truth, const std::vector<StampedPose>& estimate,
                            double max_dt_s = kDefaultMaxPairingS);

/// Relative pose error: how far the motion between two moments is off, whatever the frame of either trajectory (Sturm
/// et al., "A benchmark for the evaluation of RGB-D SLAM systems", IROS 2012, equation 1).
struct RelativePoseError {
  Summary translation_m;
  Summary rotation_rad;
  size_t num_pairs() const { return translation_m.count; }
};

/// Over all pairs of poses `delta_s` apart: from each pose that has so much time before it to the one whose distance is
/// nearest to that, left out when it is more than a tenth off. INVALID_ARGUMENT: `delta_s` not above 0, or no such
/// pair.
StatusOr<RelativePoseError> RelativePoseErrorOverTime(const std::vector<StampedPose>& truth,
                                                      const std::vector<StampedPose>& estimate, double delta_s,
                                                      double max_dt_s = kDefaultMaxPairingS);
/// The same for poses `delta_m` apart along the true path, measured between the paired poses.
StatusOr<RelativePoseError> RelativePoseErrorOverDistance(const std::vector<StampedPose>& truth,
                                                          const std::vector<StampedPose>& estimate, double delta_m,
                                                          double max_dt_s = kDefaultMaxPairingS);

}  // namespace mapp
