#pragma once

#include "mapp/base/latency.h"
#include "mapp/base/mutex.h"

#include <array>
#include <chrono>
#include <string>
#include <vector>

namespace mapp {

/// What the service does behind its calls, as operators read it.
enum class ServiceStep {
  kIntegration,   ///< association of an uploaded keyframe with the map and making its rows; not the wait for the disk
  kAlignment,     ///< comparison of a fragment's keyframe with the map, merge included
  kOptimization,  ///< of the map around a closed session
};

struct StepFigures {
  std::string step;
  LatencySummary latency;
};

/// Counts and times the service's steps. Thread-safe.
class StepTimes {
 public:
  void Add(ServiceStep step, std::chrono::nanoseconds duration);
  /// All steps, in their order.
  std::vector<StepFigures> Snapshot() const;

 private:
  mutable Mutex mutex_;
  std::array<LatencyRecorder, 3> recorders_ ABSL_GUARDED_BY(mutex_);  // by ServiceStep
};

}  // namespace mapp
