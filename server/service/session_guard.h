#pragma once

#include "mapp/base/call_context.h"
#include "mapp/base/status.h"
#include "mapp/map/tile.h"
#include "server/service/session_judge.h"
#include "storage/records.h"

#include <functional>
#include <optional>
#include <string>
#include <vector>

namespace mapp {

class MapStore;
class MapWriter;
class SessionEvents;
class TileCache;

/// FAILED_PRECONDITION naming the reason and what to do when the session is quarantined.
Status CheckNotQuarantined(const SessionRecord& session);

/// A session as it was quarantined, for whom it concerns.
struct QuarantinedSession {
  SessionId session;
  MapId map;
  Revision revision;  ///< of the map, when anything was retired
  std::string device;
  Ruling ruling;
  std::vector<FrameId> retired_frames;
  size_t num_retired_points = 0;
  std::vector<TileKey> touched_tiles;
  /// Closed sessions that a reversion leaves without points they shared with it: their optimization is owed again.
  std::vector<SessionId> neighbors;
};

struct GuardOptions {
  JudgeOptions judge;
  EvidenceOptions evidence;
  /// Told of each session, after the commit, on the writer's thread. Must not block. May be empty.
  std::function<void(const QuarantinedSession&)> on_quarantined;
};

/// Keeps sessions out of the map that contradict it or themselves (DESIGN 7; docs/decisions/0011). Thread-safe.
///
/// Quarantining a session retires, at a new revision, the frames that came after the last keyframe which agreed with
/// the map, and the points that none but these observe; others' points lose them as observers. Older frames stay.
class SessionGuard {
 public:
  SessionGuard(MapStore& store, TileCache& tiles, SessionEvents& events, const GuardOptions& options);

  const EvidenceOptions& evidence_options() const { return options_.evidence; }

  /// Within a transaction: takes the keyframe's word and quarantines the session when that is one too many; Announce()
  /// must then follow the commit. A session that an operator has released is not judged.
  StatusOr<std::optional<QuarantinedSession>> Note(MapWriter& writer, const SessionRecord& session, uint32_t keyframe,
                                                   const KeyframeEvidence& evidence);
  void Announce(const QuarantinedSession& quarantined);

  /// The same in a transaction of its own, for a keyframe that was looked at after it was stored.
  Status NoteLate(const SessionRecord& session, uint32_t keyframe, const KeyframeEvidence& evidence);

  /// An operator's word that all of the session is wrong: it is quarantined for `reason`, and every frame of it
  /// retired. With `dry_run` nothing is changed, and the result is what would be. NOT_FOUND; FAILED_PRECONDITION: it is
  /// quarantined, and nothing of it is in the map.
  StatusOr<QuarantinedSession> Revert(const CallContext& context, SessionId session, const std::string& reason,
                                      bool dry_run);

  /// An operator's word that the session is right; its record afterwards. NOT_FOUND; FAILED_PRECONDITION when it is not
  /// quarantined.
  StatusOr<SessionRecord> Release(const CallContext& context, SessionId session);

 private:
  MapStore& store_;
  TileCache& tiles_;
  SessionEvents& events_;
  const GuardOptions options_;
  SessionJudge judge_;
};

}  // namespace mapp
