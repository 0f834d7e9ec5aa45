#include "server/service/session_guard.h"

#include "mapp/base/unix_time.h"
#include "server/service/session_events.h"
#include "server/service/session_retirement.h"
#include "server/service/tile_cache.h"
#include "storage/map_store.h"

#include <fmt/format.h>

#include <set>
#include <utility>

namespace mapp {
namespace {

/// The closed ones owe their optimization again.
StatusOr<std::vector<SessionId>> OweOptimization(MapWriter& writer, const std::set<SessionId>& sessions) {
  std::vector<SessionId> closed;
  for (const SessionId id : sessions) {
    MAPP_ASSIGN_OR_RETURN(SessionRecord session, writer.GetSession(id));
    if (!session.closed_ns) continue;
    session.optimized.reset();
    MAPP_RETURN_IF_ERROR(writer.UpdateSession(session));
    closed.push_back(id);
  }
  return closed;
}

/// Within a transaction.
StatusOr<QuarantinedSession> RevertSession(MapWriter& writer, SessionId session, const std::string& reason) {
  MAPP_ASSIGN_OR_RETURN(SessionRecord record, writer.GetSession(session));
  MAPP_ASSIGN_OR_RETURN(Retirement retired, RetireFrames(writer, record, 0, RevisionCause::kReversion));
  if (retired.frames.empty() && record.IsQuarantined()) {
    return absl::FailedPreconditionError(fmt::format("session {} is quarantined, and nothing of it is in the map: {}",
                                                     session.value(), record.quarantine->reason));
  }
  record.quarantine = Quarantine{.since_ns = UnixNowNs(), .reason = reason, .released_ns = std::nullopt};
  record.optimized.reset();
  MAPP_RETURN_IF_ERROR(writer.UpdateSession(record));
  MAPP_ASSIGN_OR_RETURN(std::vector<SessionId> neighbors, OweOptimization(writer, retired.neighbors));
  return QuarantinedSession{.session = session,
                            .map = record.map,
                            .revision = retired.revision,
                            .device = record.device,
                            .ruling = {.finding = Finding::kSilent, .reason = reason},
                            .retired_frames = std::move(retired.frames),
                            .num_retired_points = retired.num_points,
                            .touched_tiles = std::move(retired.touched_tiles),
                            .neighbors = std::move(neighbors)};
}

}  // namespace

Status CheckNotQuarantined(const SessionRecord& session) {
  if (!session.IsQuarantined()) return absl::OkStatus();
  return absl::FailedPreconditionError(
      fmt::format("session {0} is quarantined since {1}: {2}. Nothing of it enters the map. Check the device's "
                  "calibration and depth scale and open a new session; if this one is right, an operator lifts the "
                  "quarantine with `mapp sessions release {0}`",
                  session.id.value(), FormatUtc(session.quarantine->since_ns), session.quarantine->reason));
}

SessionGuard::SessionGuard(MapStore& store, TileCache& tiles, SessionEvents& events, const GuardOptions& options)
    : store_(store), tiles_(tiles), events_(events), options_(options), judge_(options.judge) {}

StatusOr<std::optional<QuarantinedSession>> SessionGuard::Note(MapWriter& writer, const SessionRecord& session,
                                                               uint32_t keyframe, const KeyframeEvidence& evidence) {
  if (session.quarantine) return std::nullopt;
  std::optional<Ruling> ruling = judge_.Add(session.id, keyframe, evidence);
  if (!ruling) return std::nullopt;
  SessionRecord record = session;
  record.quarantine = Quarantine{.since_ns = UnixNowNs(), .reason = ruling->reason, .released_ns = std::nullopt};
  MAPP_RETURN_IF_ERROR(writer.UpdateSession(record));
  // A founder's frames needed nobody to vouch for them: the map began with them.
  MAPP_ASSIGN_OR_RETURN(const MapRecord map, writer.GetMap(session.map));
  const uint32_t first = map.founder == session.id ? ruling->first_contradiction : ruling->first_suspect;
  MAPP_ASSIGN_OR_RETURN(Retirement retired, RetireFrames(writer, record, first, RevisionCause::kRetirement));
  return QuarantinedSession{.session = session.id,
                            .map = session.map,
                            .revision = retired.revision,
                            .device = session.device,
                            .ruling = *std::move(ruling),
                            .retired_frames = std::move(retired.frames),
                            .num_retired_points = retired.num_points,
                            .touched_tiles = std::move(retired.touched_tiles),
                            .neighbors = {}};
}

StatusOr<QuarantinedSession> SessionGuard::Revert(const CallContext& context, SessionId session,
                                                  const std::string& reason, bool dry_run) {
  QuarantinedSession reverted;
  bool is_dry = false;
  const auto revert = [&](MapWriter& writer) -> Status {
    MAPP_ASSIGN_OR_RETURN(reverted, RevertSession(writer, session, reason));
    is_dry = dry_run;
    return dry_run ? absl::AbortedError("dry run") : absl::OkStatus();
  };
  const Status status = store_.Write(context, revert, [&] { Announce(reverted); });
  if (!is_dry) MAPP_RETURN_IF_ERROR(status);
  return reverted;
}

void SessionGuard::Announce(const QuarantinedSession& quarantined) {
  judge_.Forget(quarantined.session);
  if (!quarantined.touched_tiles.empty()) {
    tiles_.Invalidate(quarantined.map, quarantined.touched_tiles);
    events_.PublishToMap(quarantined.map, TilesChanged{quarantined.touched_tiles, quarantined.revision});
  }
  events_.Publish(quarantined.session, SessionQuarantined{quarantined.ruling.reason});
  if (options_.on_quarantined) options_.on_quarantined(quarantined);
}

Status SessionGuard::NoteLate(const SessionRecord& session, uint32_t keyframe, const KeyframeEvidence& evidence) {
  std::optional<QuarantinedSession> quarantined;
  const auto note = [&](MapWriter& writer) -> Status {
    // As it stands now: it may have been quarantined, released or deleted meanwhile.
    MAPP_ASSIGN_OR_RETURN(const SessionRecord record, writer.GetSession(session.id));
    MAPP_ASSIGN_OR_RETURN(quarantined, Note(writer, record, keyframe, evidence));
    return absl::OkStatus();
  };
  return store_.Write({}, note, [&] {
    if (quarantined) Announce(*quarantined);
  });
}

StatusOr<SessionRecord> SessionGuard::Release(const CallContext& context, SessionId session) {
  SessionRecord record;
  const auto release = [&](MapWriter& writer) -> Status {
    MAPP_ASSIGN_OR_RETURN(record, writer.GetSession(session));
    if (!record.IsQuarantined()) {
      return absl::FailedPreconditionError(fmt::format("session {} is not quarantined", session.value()));
    }
    record.quarantine->released_ns = UnixNowNs();
    return writer.UpdateSession(record);
  };
  MAPP_RETURN_IF_ERROR(store_.Write(context, release, [&] { events_.Publish(session, SessionReleased{}); }));
  return record;
}

}  // namespace mapp
