#include "eval/metrics/overlap_metrics.h"

#include <fmt/format.h>

#include <algorithm>

namespace mapp {
namespace {

Status Check(const JudgedView& view, size_t idx) {
  if (view.redundant.size() != view.known.size()) {
    return absl::InvalidArgumentError(fmt::format("view {}: {} points are judged, but the truth of {} is given", idx,
                                                  view.redundant.size(), view.known.size()));
  }
  if (!(view.overlap >= 0 && view.overlap <= 1)) {
    return absl::InvalidArgumentError(fmt::format("view {}: overlap must be in [0, 1], got {}", idx, view.overlap));
  }
  return absl::OkStatus();
}

}  // namespace

std::optional<double> OverlapScore::Resent() const {
  return Ratio(static_cast<double>(points.false_negatives),
               static_cast<double>(points.false_negatives + points.true_positives));
}

StatusOr<OverlapScore> ScoreOverlap(std::span<const JudgedView> views, double seen_overlap) {
  OverlapScore score;
  std::vector<double> estimates;
  std::vector<double> truths;
  std::vector<double> errors;
  for (size_t i = 0; i < views.size(); ++i) {
    MAPP_RETURN_IF_ERROR(Check(views[i], i));
    const std::optional<double> truth = KnownShare(views[i].known);
    if (!truth) continue;
    for (size_t k = 0; k < views[i].known.size(); ++k) score.points.Add(views[i].redundant[k], views[i].known[k]);
    score.seen.Add(views[i].overlap >= seen_overlap, *truth >= seen_overlap);
    estimates.push_back(views[i].overlap);
    truths.push_back(*truth);
    errors.push_back(views[i].overlap - *truth);
  }
  score.num_views = errors.size();
  score.bias = Mean(errors).value_or(0);
  score.rmse = RootMeanSquare(errors).value_or(0);
  score.mean_overlap = Mean(estimates).value_or(0);
  score.mean_true_overlap = Mean(truths).value_or(0);
  return score;
}

std::optional<double> KnownShare(const std::vector<bool>& known) {
  return Ratio(static_cast<double>(std::ranges::count(known, true)), static_cast<double>(known.size()));
}

}  // namespace mapp
