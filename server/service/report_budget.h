#pragma once

#include "mapp/base/id.h"
#include "mapp/base/mutex.h"
#include "mapp/base/status.h"

#include <chrono>
#include <cstddef>
#include <functional>
#include <unordered_map>

namespace mapp {

/// How much evidence one session may report, in a row and in the long run. A device sends about one report a minute of
/// its way, of some 100 points, and one whenever it leaves a shared map; replays run ten times as fast.
struct EvidenceLimits {
  double reports_per_minute = 12;
  double max_reports_at_once = 30;
  double points_per_minute = 6'000;
  double max_points_at_once = 20'000;
  std::function<std::chrono::steady_clock::time_point()> now = std::chrono::steady_clock::now;
};

/// Two token buckets a session, reports and points. Thread-safe.
class ReportBudget {
 public:
  explicit ReportBudget(EvidenceLimits limits) : limits_(std::move(limits)) {}

  /// Takes a report of so many points out of the session's budget. RESOURCE_EXHAUSTED, taking nothing: says which is
  /// exceeded and when to try again.
  Status Take(SessionId session, size_t num_points);

 private:
  struct Bucket {
    double num_reports = 0, num_points = 0;  ///< what may be reported now
    std::chrono::steady_clock::time_point filled;
  };
  /// With what has flowed in since it was asked last.
  Bucket Filled(const Bucket& bucket, std::chrono::steady_clock::time_point now) const;
  void ForgetFull(std::chrono::steady_clock::time_point now) ABSL_EXCLUSIVE_LOCKS_REQUIRED(mutex_);

  const EvidenceLimits limits_;
  Mutex mutex_;
  std::unordered_map<SessionId, Bucket> buckets_ ABSL_GUARDED_BY(mutex_);
};

}  // namespace mapp
