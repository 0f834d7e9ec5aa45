#pragma once

#include "eval/metrics/statistics.h"
#include "mapp/base/status.h"

#include <optional>
#include <span>
#include <vector>

namespace mapp {

/// One query: what the device made of its own points, and what is so.
struct JudgedView {
  std::vector<bool> redundant;  ///< per own point, by the device's count
  std::vector<bool> known;      ///< per own point, by an oracle
  double overlap = 0;           ///< the estimate that decides "seen"
};

/// Agreement of an estimator with an oracle over many views; shares are absent where there is nothing to share.
/// Terms as in the study behind DESIGN 5.
struct OverlapScore {
  size_t num_views = 0;  ///< with own points; the others have no true overlap
  BinaryScore points;    ///< REDUNDANT against known, over all points of all views
  BinaryScore seen;      ///< overlap >= T_seen against true overlap >= T_seen, over views
  double bias = 0;       ///< mean of estimate - true overlap; positive: too much is called known
  double rmse = 0;       ///< of estimate - true overlap
  double mean_overlap = 0;
  double mean_true_overlap = 0;

  /// Share of the fresh points that would be dropped.
  std::optional<double> Lost() const { return points.FalsePositiveRate(); }
  /// Share of the redundant points that would be sent all the same.
  std::optional<double> Resent() const;
};

/// INVALID_ARGUMENT: a view whose two answers differ in length, or an overlap outside [0, 1].
StatusOr<OverlapScore> ScoreOverlap(std::span<const JudgedView> views, double seen_overlap = 0.9);

/// Share of the points that are known; absent without points.
std::optional<double> KnownShare(const std::vector<bool>& known);

}  // namespace mapp
