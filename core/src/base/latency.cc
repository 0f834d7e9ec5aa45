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

void LatencyRecorder::Keep(float ms) {
  if (latest_ms_.size() < kWindow) {
    latest_ms_.push_back(ms);
    return;
  }
  latest_ms_[oldest_] = ms;
  oldest_ = (oldest_ + 1) % kWindow;
}

void LatencyRecorder::Add(std::chrono::nanoseconds duration) {
  const double ms = std::chrono::duration<double, std::milli>(duration).count();
  Keep(static_cast<float>(ms));
  ++count_;
  total_ms_ += ms;
}

void LatencyRecorder::Add(const LatencyRecorder& other) {
  for (size_t i = 0; i < other.latest_ms_.size(); ++i) {
    Keep(other.latest_ms_[(other.oldest_ + i) % other.latest_ms_.size()]);
  }
  count_ += other.count_;
  total_ms_ += other.total_ms_;
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
