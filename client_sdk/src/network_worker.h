#pragma once

#include "call_control.h"
#include "evidence_collector.h"
#include "mapp/base/rng.h"
#include "mapp/client/participant.h"
#include "redundancy_control.h"
#include "session_progress.h"
#include "shared_tiles.h"

#include <chrono>
#include <memory>
#include <optional>

namespace mapp {

/// What the sessions of one participant have in common.
struct SessionSetup {
  MapClientOptions client;
  ParticipantOptions participation;
  Camera camera;
  SensorKind sensor = SensorKind::kRgbd;
};

/// What a session's network thread does: sends keyframes by the rules of the session's state (DESIGN 3), follows
/// algorithm 1 of the paper after failures on the shared map, and closes the session. One thread only, but for Cancel.
class NetworkWorker {
 public:
  /// All but the setup is borrowed and must outlive the worker; `adapter` may be null when nothing is to be shared.
  NetworkWorker(MapClient& client, SessionProgress& progress, SlamAdapter* adapter, const SessionSetup& setup);

  /// Opens the session and waits until the server tells of its events. May be called again after a failure.
  Status Open();
  /// Opens the session, unless Open() has, as soon as it is worth it and the server can be reached; works until it is
  /// closed or progress.Stop().
  void Run();
  /// Ends the pauses between attempts. May be called from any thread.
  void Cancel() { control_.Cancel(); }

 private:
  bool OpenWhenPossible();
  void Handle(const KeyframeJob& job);
  void Handle(const FailureJob& job);
  /// Asks about the keyframe uploaded last as if it were new: the map around it may serve from here on.
  void Handle(const AlignedJob& job);
  void Handle(const ViewJob& job);
  /// Until the server has acknowledged it or says that it never will.
  void Handle(const CloseJob& job);

  /// Once, whatever comes of it.
  Status Process(const KeyframeJob& job);
  Status Upload(Keyframe keyframe);
  /// Asks how much of it the map holds, and sends the fresh part or takes the shared map.
  Status Expand(Keyframe keyframe);
  /// Counts a keyframe that need not be sent.
  Status Skip();
  /// A device that has begun another fragment, or leaves, needs no map of this one.
  bool MayShare() const;
  /// The device's own count by the answer to a query, and how long it took to count.
  struct Assessment {
    OverlapCount count;
    std::chrono::nanoseconds counting_time;
  };
  /// nullopt where the server cannot tell (session not aligned there).
  StatusOr<std::optional<Assessment>> Assess(const Keyframe& keyframe, const OwnPoints& own);

  /// What to ask for around a view from `p_map`.
  ClientSharedMapRequest WishFor(const Keyframe& view, double overlap, const Eigen::Vector3d& p_map);
  /// Asks for the map around a pose and hands it to the adapter, first tiles first. False when the map knows nothing
  /// there.
  StatusOr<bool> Share(const Keyframe& view, double overlap, Patience patience);
  /// Null when there is to be none, or it cannot be opened, which is noted.
  std::unique_ptr<TileFolder> OpenTileFolder();
  /// How the device moved lately.
  Eigen::Vector3d MotionIn(PoseFrame frame) const;
  void LeaveSharedMap();
  /// Algorithm 1, lines 11 to 16: the shared maps have failed; does the world differ from the map?
  void ReportFailure(const FailureJob& job);
  /// Sends the reports of evidence that wait, until one fails in a way that may pass: its error, the rest goes on
  /// waiting. What the server refuses for good is dropped.
  Status DeliverEvidence(Patience patience);
  /// Moves the pose from the session's frame to the map's.
  void PlaceInMap(Keyframe& keyframe) const;

  MapClient& client_;
  SessionProgress& progress_;
  SlamAdapter* const adapter_;
  const SessionSetup setup_;
  const ParticipantOptions& options_;  // in setup_
  const Camera& camera_;               // in setup_
  CallControl control_;
  std::optional<ClientSession> session_;  // once opened, as the three that follow
  std::optional<SharedTiles> tiles_;
  std::optional<EvidenceCollector> evidence_;
  std::unique_ptr<WatchHandle> watch_;
  Rng rng_{0};
  uint32_t num_shared_maps_ = 0;
  std::optional<Keyframe> last_registering_;  // uploaded last while the session was a fragment
};

}  // namespace mapp
