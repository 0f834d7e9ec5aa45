#include "server/rpc/call_recorder.h"

#include <algorithm>
#include <cmath>

namespace mapp {
namespace {

/// The smallest value that at least `share` of the values do not exceed (nearest rank). Reorders `values`.
double Quantile(std::vector<float>& values, double share) {
  if (values.empty()) return 0;
  const auto rank = static_cast<size_t>(std::ceil(share * static_cast<double>(values.size())));
  const auto nth = values.begin() + static_cast<std::ptrdiff_t>(std::max<size_t>(rank, 1) - 1);
  std::nth_element(values.begin(), nth, values.end());
  return *nth;
}

}  // namespace

void CallRecorder::Record(const std::string& method, const std::string& code, std::chrono::nanoseconds latency,
                          uint64_t bytes) {
  if (observer_ != nullptr) observer_->OnCall(method, code, latency, bytes);
  const float latency_ms = std::chrono::duration<float, std::milli>(latency).count();
  MutexLock lock(mutex_);
  Series& series = series_[method];
  if (series.latest_ms.size() < kWindow) {
    series.latest_ms.push_back(latency_ms);
  } else {
    series.latest_ms[series.num_calls % kWindow] = latency_ms;
  }
  ++series.num_calls;
  // A watch ends by its caller going away: that is no error of anybody's.
  if (code != "OK" && code != "CANCELLED") ++series.num_errors;
}

std::vector<MethodFigures> CallRecorder::Snapshot() const {
  std::map<std::string, Series> series;
  {
    MutexLock lock(mutex_);
    series = series_;
  }
  std::vector<MethodFigures> figures;
  for (auto& [method, calls] : series) {
    figures.push_back({.method = method,
                       .num_calls = calls.num_calls,
                       .num_errors = calls.num_errors,
                       .median_ms = Quantile(calls.latest_ms, 0.5),
                       .p95_ms = Quantile(calls.latest_ms, 0.95)});
  }
  return figures;
}

}  // namespace mapp
