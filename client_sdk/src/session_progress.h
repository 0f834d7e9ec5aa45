#pragma once

#include "mapp/base/latency.h"
#include "mapp/base/mutex.h"
#include "mapp/client/participant.h"

#include <array>
#include <chrono>
#include <deque>
#include <functional>
#include <map>
#include <optional>
#include <string>
#include <variant>
#include <vector>

namespace mapp {

/// A keyframe that waits for the network thread.
struct KeyframeJob {
  Keyframe keyframe;              ///< whole, pose T_session_camera, number as on the wire
  bool localized_on_map = false;  ///< its pose came after localising on a shared map: it is sent in the map's frame
  bool is_evidence = false;       ///< of a changed world (algorithm 1): sent whole, without asking
};
/// A frame that could not be localised on the shared map.
struct FailureJob {
  SharedMapFrame frame;
  std::optional<Keyframe> keyframe;  ///< whole keyframe of that frame, when the adapter could make one
  int num_maps_tried = 0;            ///< further shared maps asked for since the device last localised
};
/// A fragment was just aligned and no keyframe waits: what was uploaded last may lie where the map is known.
struct AlignedJob {};
using Job = std::variant<KeyframeJob, FailureJob, AlignedJob>;

/// What a participant's work consists of, for ParticipantLatency.
enum class Step { kOverlapAssessment, kRedundancyControl, kKeyframeUpload, kSharedMap, kUpdateReport };

/// Where a session stands: the queue and the state that the app's thread, the network thread and the watch
/// thread share. Knows nothing of the network. Thread-safe.
class SessionProgress {
 public:
  explicit SessionProgress(size_t max_queued) : max_queued_(max_queued) {}

  // From the app.
  void AddKeyframe(Keyframe keyframe);
  /// True when the frame failed on the present shared map and no other failure is in hand: AddFailure must follow.
  bool BeginFailure(const SharedMapFrame& frame);
  void AddFailure(const SharedMapFrame& frame, std::optional<Keyframe> keyframe);
  /// Keyframes added from now on are dropped.
  void CloseIntake();
  /// Until nothing is queued or under way and no failure is in hand; with `compared` also until the server has compared
  /// the last unaligned upload with the map. DEADLINE_EXCEEDED naming what is missing.
  Status Wait(std::chrono::steady_clock::time_point deadline, bool compared);
  /// Until the stream of events stands for the first time.
  Status WaitForWatch(std::chrono::steady_clock::time_point deadline);

  // From the network thread.
  /// Blocks; nullopt after Stop(). Failures come before keyframes, these before AlignedJob. JobDone() must follow.
  std::optional<Job> NextJob();
  void JobDone();
  /// Puts a keyframe of a failed frame at the queue's head, numbered after all keyframes so far.
  void AddEvidence(Keyframe keyframe, bool localized_on_map);
  void OnUploaded(uint32_t number, const ClientUpload& upload);
  void OnSharedMap(uint32_t number);  ///< the adapter is about to get it
  void OnLeftSharedMap();
  /// Tiles that the server has changed since the last call, and the revisions that did it.
  std::map<TileKey, Revision> TakeChangedTiles();
  void UpdateStats(const std::function<void(ParticipantStats&)>& change);
  void RecordLatency(Step step, std::chrono::nanoseconds duration);

  // From the watch thread.
  void OnEvent(const ClientEvent& event);

  // Closing.
  enum class OptimizationWait { kEnded, kWatchRestarted, kTimedOut };
  /// Until the optimisation has ended, or the stream that tells of it was restarted and its end may have been missed.
  OptimizationWait WaitForOptimization(std::chrono::steady_clock::time_point deadline);
  void SetClosed();
  void Stop();  ///< ends NextJob and all waits

  ParticipantState state() const;
  std::optional<Pose3> T_map_session() const;
  ParticipantStats stats() const;

 private:
  struct EventVisitor;

  void Align(const Pose3& T_map_session, uint32_t keyframe) ABSL_EXCLUSIVE_LOCKS_REQUIRED(mutex_);
  LatencySummary Summary(Step step) const ABSL_EXCLUSIVE_LOCKS_REQUIRED(mutex_);
  /// Empty when nothing is left to do.
  std::string Missing(bool compared) const ABSL_EXCLUSIVE_LOCKS_REQUIRED(mutex_);

  const size_t max_queued_;
  mutable Mutex mutex_;
  CondVar changed_;
  ParticipantState state_ ABSL_GUARDED_BY(mutex_) = ParticipantState::kRegistering;
  std::optional<Pose3> T_map_session_ ABSL_GUARDED_BY(mutex_);
  ParticipantStats stats_ ABSL_GUARDED_BY(mutex_);                  // but for its latencies
  std::array<LatencyRecorder, 5> latency_ ABSL_GUARDED_BY(mutex_);  // by Step

  std::deque<KeyframeJob> queue_ ABSL_GUARDED_BY(mutex_);
  bool busy_ ABSL_GUARDED_BY(mutex_) = false;
  bool intake_closed_ ABSL_GUARDED_BY(mutex_) = false;
  bool stopped_ ABSL_GUARDED_BY(mutex_) = false;
  uint32_t next_number_ ABSL_GUARDED_BY(mutex_) = 0;   // on the wire
  uint32_t num_evidence_ ABSL_GUARDED_BY(mutex_) = 0;  // what wire numbers are ahead of the adapter's

  // Registering: uploads the server has yet to compare with the map.
  std::optional<uint32_t> last_unaligned_upload_ ABSL_GUARDED_BY(mutex_);
  std::optional<uint32_t> last_compared_ ABSL_GUARDED_BY(mutex_);
  bool just_aligned_ ABSL_GUARDED_BY(mutex_) = false;  // an AlignedJob is due

  // Sharing.
  uint32_t shared_map_number_ ABSL_GUARDED_BY(mutex_) = 0;
  bool localized_on_map_ ABSL_GUARDED_BY(mutex_) = false;
  bool failure_in_hand_ ABSL_GUARDED_BY(mutex_) = false;  // from BeginFailure until a new map or leaving
  int num_maps_tried_ ABSL_GUARDED_BY(mutex_) = 0;
  std::optional<FailureJob> failure_ ABSL_GUARDED_BY(mutex_);
  std::map<TileKey, Revision> changed_tiles_ ABSL_GUARDED_BY(mutex_);

  int num_watch_starts_ ABSL_GUARDED_BY(mutex_) = 0;
  int num_watch_starts_seen_ ABSL_GUARDED_BY(mutex_) = 0;  // by WaitForWatch and WaitForOptimization
  bool optimized_ ABSL_GUARDED_BY(mutex_) = false;
};

}  // namespace mapp
