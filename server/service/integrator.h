#pragma once

#include "mapp/base/call_context.h"
#include "mapp/base/status.h"
#include "server/service/associator.h"
#include "server/service/service_types.h"

#include <span>
#include <string>

namespace mapp {

class MapStore;
class MapWriter;
class Registrar;
struct ReplayGuide;
class SessionEvents;
class SessionGuard;
class StepTimes;
class TileCache;

struct IntegratorOptions {
  /// Greatest packet accepted, bytes.
  size_t max_packet_bytes = size_t{64} << 10;
  AssociationOptions association;
  /// Told how long each run took. Borrowed; may be null.
  StepTimes* step_times = nullptr;
  /// Borrowed; null but where a log is replayed.
  const ReplayGuide* replay = nullptr;
};

/// Takes uploaded keyframes into the map (DESIGN 7): everything that one changes is one transaction, and the caches
/// and listeners follow in commit order. Thread-safe.
class Integrator {
 public:
  Integrator(MapStore& store, TileCache& tiles, SessionEvents& events, Registrar& registrar, SessionGuard& guard,
             const IntegratorOptions& options);

  /// `packet`: codec/keyframe_codec.h. Durable when it returns OK; sent again, it changes nothing. The first keyframe
  /// of a session in a map without a founder founds the frame `map`: in metres, or, when the session is of a single
  /// camera, as one of unknown scale whose unit makes the keyframe's median depth kNominalDepthM (map_scale.h).
  /// Keyframes of sessions that are not aligned stay in their session's frame as its fragment. Each is judged
  /// (session_guard.h); one that contradicts its session or the map outright goes to the keyframe log alone, and after
  /// some of them the session is quarantined. INVALID_ARGUMENT: malformed. NOT_FOUND: no such session.
  /// FAILED_PRECONDITION: the session is closed or quarantined, or tells a pose in the map before it is aligned.
  StatusOr<UploadResult> Integrate(const CallContext& context, const std::string& packet);

  /// Takes into the map what an aligned session has in the keyframe log alone, in its order, unjudged; the number of
  /// frames. Errors as Integrate, and DATA_LOSS.
  StatusOr<size_t> IntegrateLeftOut(const CallContext& context, SessionId session);

 private:
  struct Upload;
  struct Outcome;

  StatusOr<Associations> Associate(const Upload& upload) const;
  Status Store(MapWriter& writer, const Upload& upload, Outcome& outcome) const;
  /// The upload's keyframe, its lengths in the unit that the session has now.
  static Keyframe InUnitOf(const SessionRecord& session, const Upload& upload);
  /// The keyframe's own word, and the map's about it.
  KeyframeEvidence Judge(const Upload& upload, const Keyframe& keyframe, const Pose3& T_frame_camera,
                         std::span<const KnownPoint> known) const;
  Status IntegrateLogged(const CallContext& context, FrameId frame);
  void Announce(const Upload& upload, const Outcome& outcome) const;

  MapStore& store_;
  TileCache& tiles_;
  SessionEvents& events_;
  Registrar& registrar_;
  SessionGuard& guard_;
  const IntegratorOptions options_;
};

}  // namespace mapp
