#pragma once

#include <chrono>
#include <cstdint>
#include <vector>

namespace mapp {

/// How long the runs of one step took, milliseconds.
struct LatencySummary {
  uint64_t count = 0;
  double mean_ms = 0;  ///< over all runs
  double p50_ms = 0;   ///< percentiles by nearest rank, over the latest LatencyRecorder::kWindow runs
  double p95_ms = 0;

  double total_ms() const { return mean_ms * static_cast<double>(count); }
};

/// Counts the runs of a step and keeps the latest. Not thread-safe.
class LatencyRecorder {
 public:
  static constexpr size_t kWindow = 4096;

  void Add(std::chrono::nanoseconds duration);
  /// Adds another recorder's runs as if they had come after this one's.
  void Add(const LatencyRecorder& other);
  LatencySummary Summary() const;

 private:
  void Keep(float ms);

  uint64_t count_ = 0;
  double total_ms_ = 0;
  std::vector<float> latest_ms_;  // ring of kWindow, filled first
  size_t oldest_ = 0;             // in a full ring
};

/// Wall time since its construction.
class Stopwatch {
 public:
  std::chrono::nanoseconds Elapsed() const { return std::chrono::steady_clock::now() - start_; }

 private:
  std::chrono::steady_clock::time_point start_ = std::chrono::steady_clock::now();
};

}  // namespace mapp
