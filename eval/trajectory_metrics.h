#pragma once

#include "datasets/sequence.h"
#include "mapp/base/status.h"

#include <vector>

namespace mapp {

struct TrajectoryError {
  double rmse_m = 0;
  double mean_m = 0;
  double max_m = 0;
  size_t num_paired = 0;
  Sim3 T_truth_estimate;  ///< the alignment used
};

/// Absolute trajectory error: each estimated pose paired with the nearest true time within `max_dt_s`, aligned by
/// Umeyama (SE3, or Sim3 `with_scale`), RMSE of positions. INVALID_ARGUMENT below 3 pairs.
StatusOr<TrajectoryError> AbsoluteTrajectoryError(const std::vector<StampedPose>& truth,
                                                  const std::vector<StampedPose>& estimate, bool with_scale,
                                                  double max_dt_s = 0.02);
/// The same under an alignment found elsewhere: how a merged map is judged.
StatusOr<TrajectoryError> TrajectoryErrorUnder(const Sim3& T_truth_estimate, const std::vector<StampedPose>& truth,
                                               const std::vector<StampedPose>& estimate, double max_dt_s = 0.02);

}  // namespace mapp
