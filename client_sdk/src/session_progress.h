#pragma once

#include "mapp/base/mutex.h"
#include "mapp/client/participant.h"
#include "recent_way.h"
#include "session_figures.h"

#include <algorithm>
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
/// A frame that was localised on a shared map: what it measured there.
struct ViewJob {
  Keyframe keyframe;  ///< whole, pose T_session_camera
  uint32_t shared_map_number = 0;
};
/// A fragment was just aligned and no keyframe waits: what was uploaded last may lie where the map is known.
struct AlignedJob {};
/// Nothing else is left and nothing more will come.
struct CloseJob {};
using Job = std::variant<KeyframeJob, FailureJob, AlignedJob, ViewJob, CloseJob>;

/// Where a session stands: the queue and the state that the app's thread, the network thread and the watch
/// thread share. Knows nothing of the network. Thread-safe.
class SessionProgress {
 public:
  /// `min_to_open`: keyframes that must wait before the session is worth opening; 0 for one that is opened at once.
  SessionProgress(size_t max_queued, size_t min_to_open)
      : max_queued_(max_queued), min_to_open_(std::min(min_to_open, max_queued)) {}

  // From the app.
  void AddKeyframe(Keyframe keyframe);
  /// True when the frame failed on the present shared map and no other failure is in hand: AddFailure must follow.
  bool BeginFailure(const SharedMapFrame& frame);
  void AddFailure(const SharedMapFrame& frame, std::optional<Keyframe> keyframe);
  /// True when the frame was localised on the present shared map, away enough from the last for which this was true:
  /// AddView may follow.
  bool WantsView(const SharedMapFrame& frame);
  /// Dropped where the network thread has fallen behind.
  void AddView(Keyframe keyframe, uint32_t shared_map_number);
  /// Keyframes added from now on are dropped, no map is asked for any more, and a CloseJob follows what is queued.
  void BeginClose();
  /// Until nothing is queued or under way, no failure is in hand, and the server has compared the last unaligned upload
  /// with the map. DEADLINE_EXCEEDED naming what is missing.
  Status WaitIdle(std::chrono::steady_clock::time_point deadline);
  /// Until the session is closed: OK, or why it could not be opened or closed. An attempt to close that fails from now
  /// on gives its error, though others follow.
  Status WaitClosed(std::chrono::steady_clock::time_point deadline);
  /// Until the stream of events stands for the first time.
  Status WaitForWatch(std::chrono::steady_clock::time_point deadline);

  // From the network thread.
  /// Blocks until the session is worth opening. False when it will never be: stopped, or closed before.
  bool WaitUntilWorthOpening();
  void OnOpened(SessionId session);
  /// The server will not have the session: what is queued and what comes is refused.
  void OnOpeningRefused(const Status& why);
  /// Blocks; nullopt after Stop() and once the session is closed. Failures come before keyframes, these before
  /// AlignedJob and ViewJob, CloseJob is the last. JobDone() must follow.
  std::optional<Job> NextJob();
  void JobDone();
  /// Puts a keyframe of a failed frame at the queue's head, numbered after all keyframes so far.
  void AddEvidence(Keyframe keyframe, bool localized_on_map);
  void OnUploaded(uint32_t number, const ClientUpload& upload);
  void OnSharedMap(uint32_t number);  ///< the adapter is about to get it
  /// The map that OnSharedMap told of has come whole, under a number of its own. What failed on part of it is no
  /// matter.
  void OnSharedMapWhole(uint32_t number);
  void OnLeftSharedMap();
  /// Tiles that the server has changed since the last call, and the revisions that did it.
  std::map<TileKey, Revision> TakeChangedTiles();
  /// How the device moved lately, as far as keyframes and frames on shared maps told; RecentWay::Motion().
  Eigen::Vector3d motion_session() const;
  void OnCloseFailed(const Status& why);  ///< another attempt follows
  void OnClosed(bool optimization_pending);
  void OnCloseRefused(const Status& why);
  void UpdateStats(const std::function<void(ParticipantStats&)>& change);
  void RecordLatency(Step step, std::chrono::nanoseconds duration);

  // From the watch thread.
  void OnEvent(const ClientEvent& event);

  // Ending.
  enum class OptimizationWait { kEnded, kWatchRestarted, kTimedOut };
  /// Until no optimisation is owed, or the stream that tells of it was restarted and its end may have been missed.
  OptimizationWait WaitForOptimization(std::chrono::steady_clock::time_point deadline);
  void Stop();  ///< ends NextJob and all waits; what is queued is dropped

  ParticipantState state() const;
  bool closing() const;  ///< or closed
  std::optional<SessionId> session() const;
  std::optional<Pose3> T_map_session() const;
  std::optional<Sim3> S_map_session() const;
  SessionFigures figures() const;

 private:
  struct EventVisitor;

  void Align(const Sim3& S_map_session, uint32_t keyframe) ABSL_EXCLUSIVE_LOCKS_REQUIRED(mutex_);
  void End(const Status& outcome) ABSL_EXCLUSIVE_LOCKS_REQUIRED(mutex_);
  /// Empty when nothing is left to do.
  std::string Missing() const ABSL_EXCLUSIVE_LOCKS_REQUIRED(mutex_);

  const size_t max_queued_;
  const size_t min_to_open_;
  mutable Mutex mutex_;
  CondVar changed_;
  ParticipantState state_ ABSL_GUARDED_BY(mutex_) = ParticipantState::kRegistering;
  std::optional<Sim3> S_map_session_ ABSL_GUARDED_BY(mutex_);
  std::optional<SessionId> session_ ABSL_GUARDED_BY(mutex_);
  SessionFigures figures_ ABSL_GUARDED_BY(mutex_);

  std::deque<KeyframeJob> queue_ ABSL_GUARDED_BY(mutex_);
  bool busy_ ABSL_GUARDED_BY(mutex_) = false;
  bool closing_ ABSL_GUARDED_BY(mutex_) = false;
  bool close_in_hand_ ABSL_GUARDED_BY(mutex_) = false;  // CloseJob is under way
  int num_close_failures_ ABSL_GUARDED_BY(mutex_) = 0;
  Status close_failure_ ABSL_GUARDED_BY(mutex_);
  Status outcome_ ABSL_GUARDED_BY(mutex_);  // once closed
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
  std::deque<ViewJob> views_ ABSL_GUARDED_BY(mutex_);
  std::optional<Pose3> T_session_camera_viewed_ ABSL_GUARDED_BY(mutex_);  // of the last frame that WantsView took
  RecentWay recent_way_ ABSL_GUARDED_BY(mutex_);

  int num_watch_starts_ ABSL_GUARDED_BY(mutex_) = 0;
  int num_watch_starts_seen_ ABSL_GUARDED_BY(mutex_) = 0;  // by WaitForWatch and WaitForOptimization
  bool optimized_ ABSL_GUARDED_BY(mutex_) = false;
  bool optimization_pending_ ABSL_GUARDED_BY(mutex_) = false;  // as the server said when it closed the session
};

}  // namespace mapp
