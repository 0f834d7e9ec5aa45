#include "mapp/base/latency.h"

#include <algorithm>
#include <cmath>

namespace mapp {
namespace {

/// The smallest value that at least `share` of the values do not exceed. Reorders `values`.
double NearestRank(std::vector<float>& values, double share) {
  if (values.empty()) return 0;
  const auto rank = static_cast<size_t>(std::ceil(share * static_cast<double>(values.size())));
  const auto nth = values.begin() + static_cast<std::ptrdiff_t>(std::max<size_t>(rank, 1) - 1);
  std::nth_element(values.begin(), nth, values.end());
  return *nth;
}

}  // namespace

void LatencyRecorder::Add(std::chrono::nanoseconds duration) {
  const double ms = std::chrono::duration<double, std::milli>(duration).count();
  if (latest_ms_.size() < kWindow) {
    latest_ms_.push_back(static_cast<float>(ms));
  } else {
    latest_ms_[count_ % kWindow] = static_cast<float>(ms);
  }
  ++count_;
  total_ms_ += ms;
}

LatencySummary LatencyRecorder::Summary() const {
  std::vector<float> latest_ms = latest_ms_;
  LatencySummary summary;
  summary.count = count_;
  if (count_ > 0) summary.mean_ms = total_ms_ / static_cast<double>(count_);
  summary.p50_ms = NearestRank(latest_ms, 0.5);
  summary.p95_ms = NearestRank(latest_ms, 0.95);
  return summary;
}

}  // namespace mapp
