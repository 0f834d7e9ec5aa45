#pragma once

#include "mapp/base/mutex.h"
#include "mapp/client/map_client.h"
#include "mapp/client/participant.h"
#include "network_worker.h"
#include "session_progress.h"

#include <chrono>
#include <functional>
#include <memory>
#include <optional>
#include <thread>

namespace mapp {

/// Passes calls on until the fragment that they are meant for has ended: a map in the frame of one fragment is a lie in
/// another. Thread-safe.
class FragmentAdapter final : public SlamAdapter {
 public:
  /// `system` is borrowed.
  explicit FragmentAdapter(SlamAdapter* system) : system_(system) {}

  void TakeSharedMap(std::shared_ptr<const SharedMap> map) override;
  void LeaveSharedMap() override;
  /// No call is passed on, or still under way, once this has returned.
  void Silence();

 private:
  Mutex mutex_;  // held during the calls, which must not block
  SlamAdapter* system_ ABSL_GUARDED_BY(mutex_);
};

/// The session of one fragment: its connection, its network thread and where it stands. Thread-safe.
class FragmentSession {
 public:
  /// `client` is the session's own. `min_to_open`: as SessionProgress takes it. `adapter` may be null.
  FragmentSession(std::unique_ptr<MapClient> client, const SessionSetup& setup, SlamAdapter* adapter,
                  size_t min_to_open);
  /// Ends the calls under way; what is queued is dropped.
  ~FragmentSession();

  /// Opens the session on the caller's thread and begins to work.
  Status Open();
  /// Begins to work; the network thread opens the session, for as long as that takes.
  void OpenInBackground();

  void OnKeyframe(Keyframe keyframe);
  void OnSharedMapFrame(const SharedMapFrame& frame, const std::function<std::optional<Keyframe>()>& last_keyframe);
  /// The device has begun another fragment: the adapter hears nothing more, and the session closes by itself once all
  /// that was handed in has been sent.
  void EndFragment();
  void BeginClose() { progress_.BeginClose(); }

  Status WaitIdle(std::chrono::steady_clock::time_point deadline) { return progress_.WaitIdle(deadline); }
  /// After BeginClose(): until the session is closed, or has ended otherwise, and the optimisation that follows is
  /// done.
  Status WaitEnded(std::chrono::steady_clock::time_point deadline);
  /// As Participant::Close.
  Status Close(std::chrono::steady_clock::time_point deadline, bool wait_for_optimization);
  /// Where the map has the fragment's keyframes now; none while it is not aligned.
  StatusOr<std::vector<ClientKeyframePose>> FetchKeyframePoses();
  /// Ends the calls under way and drops what is queued. Idempotent.
  void Stop();

  ParticipantState state() const { return progress_.state(); }
  std::optional<SessionId> session() const { return progress_.session(); }
  std::optional<Pose3> T_map_session() const { return progress_.T_map_session(); }
  std::optional<Sim3> S_map_session() const { return progress_.S_map_session(); }
  SessionFigures figures() const;
  ParticipantFragment Describe() const;

 private:
  Status WaitForOptimization(std::chrono::steady_clock::time_point deadline);
  /// What a frame that was localised on the shared map measured.
  void AddView(const SharedMapFrame& frame, std::optional<Keyframe> keyframe);

  const std::unique_ptr<MapClient> client_;
  const Camera camera_;
  const FeatureSettings features_;
  const bool report_evidence_;
  FragmentAdapter adapter_;
  SessionProgress progress_;
  NetworkWorker worker_;  // its events end before what they change
  std::thread thread_;    // last: uses all of the above
};

}  // namespace mapp
