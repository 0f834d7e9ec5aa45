#include "eval/metrics/reconstruction_metrics.h"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <vector>

namespace mapp {
namespace {

double ShareWithin(const std::vector<double>& distances_m, double bound_m) {
  const auto within = std::ranges::count_if(distances_m, [&](double distance_m) { return distance_m <= bound_m; });
  return static_cast<double>(within) / static_cast<double>(distances_m.size());
}

}  // namespace

StatusOr<ReconstructionError> MeasureReconstruction(std::span<const Eigen::Vector3d> p_map, const Sim3& T_truth_map,
                                                    const SurfaceDistance& distance_m) {
  if (p_map.empty()) return absl::InvalidArgumentError("reconstruction: the map has no points");
  std::vector<double> distances_m;
  distances_m.reserve(p_map.size());
  for (size_t i = 0; i < p_map.size(); ++i) {
    if (!p_map[i].allFinite()) return absl::InvalidArgumentError(fmt::format("point {}: not finite", i));
    distances_m.push_back(distance_m(T_truth_map * p_map[i]));
    if (!std::isfinite(distances_m.back()) || distances_m.back() < 0) {
      return absl::InvalidArgumentError(fmt::format(
          "point {}: distance to the surfaces must be finite and not negative, got {}", i, distances_m.back()));
    }
  }
  return ReconstructionError{Summarize(distances_m), ShareWithin(distances_m, 0.05), ShareWithin(distances_m, 0.10),
                             ShareWithin(distances_m, 0.20)};
}

}  // namespace mapp
