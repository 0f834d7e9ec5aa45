#include "server/rpc/call_recorder.h"

namespace mapp {

void CallRecorder::Record(const std::string& method, const std::string& code, std::chrono::nanoseconds latency,
                          uint64_t bytes) {
  if (observer_ != nullptr) observer_->OnCall(method, code, latency, bytes);
  MutexLock lock(mutex_);
  Series& series = series_[method];
  series.latency.Add(latency);
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
  for (const auto& [method, calls] : series) {
    figures.push_back({.method = method, .num_errors = calls.num_errors, .latency = calls.latency.Summary()});
  }
  return figures;
}

}  // namespace mapp
