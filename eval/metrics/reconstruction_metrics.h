#pragma once

#include "eval/metrics/statistics.h"
#include "mapp/base/status.h"
#include "mapp/geometry/pose3.h"

#include <Eigen/Core>

#include <functional>
#include <span>

namespace mapp {

/// Distance from a point of the truth's frame to the nearest true surface, metres.
using SurfaceDistance = std::function<double(const Eigen::Vector3d& p_truth)>;

/// How far the points of a map lie from the surfaces that there are. A point of something that has gone since counts by
/// its distance to what is there now: give the surfaces of the time that the map is to show.
struct ReconstructionError {
  Summary distance_m;                                       ///< `rms` is the RMSE of the paper's figure
  double within_5cm = 0, within_10cm = 0, within_20cm = 0;  ///< shares of the points
};

/// INVALID_ARGUMENT: no points, a point that is not finite, or a distance that is not finite and at least 0.
StatusOr<ReconstructionError> MeasureReconstruction(std::span<const Eigen::Vector3d> p_map, const Sim3& T_truth_map,
                                                    const SurfaceDistance& distance_m);

}  // namespace mapp
