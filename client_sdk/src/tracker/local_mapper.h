#pragma once

#include "client_sdk/src/tracker/session_map.h"
#include "client_sdk/src/tracker/tracking_camera.h"
#include "mapp/base/mutex.h"
#include "mapp/client/orb_tracker.h"
#include "mapp/map/keyframe.h"

#include <deque>
#include <thread>
#include <vector>

namespace mapp::tracker {

/// Turns the keyframes that tracking adds into a consistent map: culls weak points, triangulates, fuses duplicates,
/// adjusts the neighborhood, and hands the keyframe out. Jobs run in order, in a thread of their own or, when
/// synchronous, in the caller's. Thread-safe.
class LocalMapper {
 public:
  LocalMapper(SharedSessionMap& shared, const TrackingCamera& camera, const OrbTrackerOptions& options);
  /// Waits for the job at hand; jobs still waiting are dropped.
  ~LocalMapper();
  LocalMapper(const LocalMapper&) = delete;
  LocalMapper& operator=(const LocalMapper&) = delete;

  /// A keyframe that tracking has put into the map.
  void ProcessKeyframe(int keyframe_idx);
  /// Retires a generation once the keyframes handed in before are done.
  void RetireGeneration(int generation);

  /// Keyframes finished since the last call, numbered in order from 0.
  std::vector<Keyframe> TakeFinished();
  void WaitIdle();
  size_t num_waiting() const;
  bool idle() const;
  double cpu_s() const;
  LatencyRecorder latency() const;  ///< of each keyframe

 private:
  struct Job {
    enum class Kind { kProcessKeyframe, kRetireGeneration };
    Kind kind = Kind::kProcessKeyframe;
    int argument = 0;  ///< keyframe_idx or generation
  };

  void Submit(Job job);
  void Run();
  void Execute(const Job& job);
  void Process(int keyframe_idx);
  void CullRecentPoints(int keyframe_idx);

  // Constant after construction.
  SharedSessionMap& shared_;
  const TrackingCamera& camera_;
  const OrbTrackerOptions options_;

  std::vector<int> recent_points_;  ///< made by the last keyframes, on probation; used by the jobs only

  mutable Mutex mutex_;
  CondVar changed_;
  std::deque<Job> waiting_ ABSL_GUARDED_BY(mutex_);
  bool busy_ ABSL_GUARDED_BY(mutex_) = false;
  bool stopping_ ABSL_GUARDED_BY(mutex_) = false;
  std::vector<Keyframe> finished_ ABSL_GUARDED_BY(mutex_);
  uint32_t next_number_ ABSL_GUARDED_BY(mutex_) = 0;
  LatencyRecorder latency_ ABSL_GUARDED_BY(mutex_);
  double cpu_s_ ABSL_GUARDED_BY(mutex_) = 0;

  std::thread thread_;  ///< last: it uses everything above
};

}  // namespace mapp::tracker
