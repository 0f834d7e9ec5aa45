#pragma once

#include "call_control.h"
#include "mapp/base/rng.h"
#include "mapp/client/participant.h"
#include "redundancy_control.h"
#include "session_progress.h"
#include "shared_tiles.h"

#include <optional>

namespace mapp {

/// What a participant's network thread does: sends keyframes by the rules of the session's state (DESIGN 3) and follows
/// algorithm 1 of the paper after failures on the shared map. One thread only, but for Cancel.
class NetworkWorker {
 public:
  /// All but the options and the camera are borrowed and must outlive the worker; `adapter` may be null when nothing is
  /// to be shared.
  NetworkWorker(MapClient& client, SessionProgress& progress, SlamAdapter* adapter, const ParticipantOptions& options,
                const ClientSession& session, const Camera& camera);

  /// Works until progress.Stop().
  void Run();
  /// Ends the pauses between attempts. May be called from any thread.
  void Cancel() { control_.Cancel(); }

 private:
  void Handle(const KeyframeJob& job);
  void Handle(const FailureJob& job);
  /// Asks about the keyframe uploaded last as if it were new: the map around it may serve from here on.
  void Handle(const AlignedJob& job);

  /// Once, whatever comes of it.
  Status Process(const KeyframeJob& job);
  Status Upload(const Keyframe& keyframe);
  /// Asks how much of it the map holds, and sends the fresh part or takes the shared map.
  Status Expand(Keyframe keyframe);
  /// Counts a keyframe that need not be sent.
  Status Skip();
  /// The device's own count by the answer to a query, and how long it took to count.
  struct Assessment {
    OverlapCount count;
    std::chrono::nanoseconds counting_time;
  };
  /// nullopt where the server cannot tell (session not aligned there).
  StatusOr<std::optional<Assessment>> Assess(const Keyframe& keyframe, const OwnPoints& own);

  /// Asks for the map around a pose and hands it to the adapter. False when the map knows nothing there.
  StatusOr<bool> Share(const Keyframe& view, double overlap, Patience patience);
  void LeaveSharedMap();
  /// Algorithm 1, lines 11 to 16: the shared maps have failed; does the world differ from the map?
  void ReportFailure(const FailureJob& job);
  /// Moves the pose from the session's frame to the map's.
  void PlaceInMap(Keyframe& keyframe) const;

  MapClient& client_;
  SessionProgress& progress_;
  SlamAdapter* const adapter_;
  const ParticipantOptions options_;
  const ClientSession session_;
  const Camera camera_;
  CallControl control_;
  SharedTiles tiles_;
  Rng rng_;
  uint32_t num_shared_maps_ = 0;
  std::optional<Keyframe> last_registering_;  // uploaded last while the session was a fragment
};

}  // namespace mapp
