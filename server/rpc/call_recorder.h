#pragma once

#include "mapp/base/latency.h"
#include "mapp/base/mutex.h"

#include <chrono>
#include <cstdint>
#include <map>
#include <memory>
#include <string>
#include <vector>

namespace mapp {

/// Figures of one method since the start.
struct MethodFigures {
  std::string method;
  uint64_t num_errors = 0;
  LatencySummary latency;  ///< time inside the server; its count is that of all calls
};

/// Receives every finished call, on the call's thread; must not block.
class CallObserver {
 public:
  virtual ~CallObserver() = default;
  virtual void OnCall(const std::string& method, const std::string& code, std::chrono::nanoseconds latency,
                      uint64_t bytes) = 0;
};

/// Counts calls and keeps the latest latencies of each method. Thread-safe.
class CallRecorder {
 public:
  /// `observer` may be null; else it must outlive the recorder.
  explicit CallRecorder(CallObserver* observer) : observer_(observer) {}

  /// `code`: "OK", "NOT_FOUND", ...; `bytes`: serialised, both ways.
  void Record(const std::string& method, const std::string& code, std::chrono::nanoseconds latency, uint64_t bytes);
  /// Ordered by method.
  std::vector<MethodFigures> Snapshot() const;

 private:
  struct Series {
    uint64_t num_errors = 0;
    LatencyRecorder latency;
  };
  CallObserver* const observer_;
  mutable Mutex mutex_;
  std::map<std::string, Series> series_ ABSL_GUARDED_BY(mutex_);
};

}  // namespace mapp
