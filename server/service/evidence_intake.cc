#include "server/service/evidence_intake.h"

#include "mapp/codec/evidence_codec.h"
#include "server/service/session_guard.h"
#include "server/service/session_view.h"
#include "storage/map_store.h"

#include <fmt/format.h>

#include <map>
#include <unordered_set>
#include <vector>

namespace mapp {
namespace {

Status CheckMayReport(const SessionRecord& session) {
  MAPP_RETURN_IF_ERROR(CheckOpen(session));
  MAPP_RETURN_IF_ERROR(CheckNotQuarantined(session));
  if (session.T_map_session) return absl::OkStatus();
  return absl::FailedPreconditionError(fmt::format(
      "session {} is not aligned with its map yet: it cannot have looked for points there; report once it is",
      session.id.value()));
}

/// Those of the points that are in the map. A device may hold a tile of before points were retired or fused.
StatusOr<std::vector<PointFinding>> InMap(MapReader& reader, MapId map, const std::vector<PointFinding>& findings) {
  std::vector<MapPointId> ids;
  for (const PointFinding& finding : findings) ids.push_back(finding.point);
  MAPP_ASSIGN_OR_RETURN(const std::vector<PointRecord> points, reader.FindPoints(ids));
  std::map<SessionId, MapId> map_of;
  std::unordered_set<MapPointId> in_map;
  for (const PointRecord& point : points) {
    auto founder = map_of.find(point.session);
    if (founder == map_of.end()) {
      MAPP_ASSIGN_OR_RETURN(const SessionRecord session, reader.GetSession(point.session));
      founder = map_of.emplace(point.session, session.map).first;
    }
    if (point.in_map && founder->second == map) in_map.insert(point.id);
  }
  std::vector<PointFinding> found;
  for (const PointFinding& finding : findings) {
    if (in_map.contains(finding.point)) found.push_back(finding);
  }
  return found;
}

}  // namespace

StatusOr<StoredEvidence> EvidenceIntake::Take(const CallContext& context, SessionId session, uint32_t number,
                                              const std::string& packet) {
  MAPP_RETURN_IF_ERROR(context.Check());
  MAPP_ASSIGN_OR_RETURN(const std::vector<PointFinding> findings, DecodeEvidence(packet));
  if (findings.empty()) {
    return absl::InvalidArgumentError("evidence: no points; report once some were seen or missed");
  }
  std::vector<PointFinding> known;
  {
    MAPP_ASSIGN_OR_RETURN(const std::unique_ptr<MapReader> reader, store_.Read());
    MAPP_ASSIGN_OR_RETURN(const SessionRecord record, reader->GetSession(session));
    MAPP_ASSIGN_OR_RETURN(const bool is_stored, reader->HasEvidence(session, number));
    if (is_stored) return StoredEvidence{.already_stored = true};
    MAPP_RETURN_IF_ERROR(CheckMayReport(record));
    MAPP_RETURN_IF_ERROR(budget_.Take(session, findings.size()));
    MAPP_ASSIGN_OR_RETURN(known, InMap(*reader, record.map, findings));
    if (known.empty()) {
      MAPP_ASSIGN_OR_RETURN(const MapRecord map, reader->GetMap(record.map));
      return absl::InvalidArgumentError(
          fmt::format("evidence: map \"{}\" has none of the {} points, or no longer: drop the report and ask for the "
                      "shared map again",
                      map.name, findings.size()));
    }
  }
  StoredEvidence stored{
      .already_stored = false, .num_points = known.size(), .num_unknown_points = findings.size() - known.size()};
  const EvidenceRecord evidence{
      .session = session, .number = number, .received_ns = 0, .packet = EncodeEvidence(known)};
  const auto append = [&](MapWriter& writer) -> Status {
    // Read again: since the first look, the same report may have been stored, or the session closed or quarantined.
    MAPP_ASSIGN_OR_RETURN(const SessionRecord record, writer.GetSession(session));
    MAPP_ASSIGN_OR_RETURN(const bool is_stored, writer.HasEvidence(session, number));
    if (is_stored) {
      stored = {.already_stored = true};
      return absl::OkStatus();
    }
    MAPP_RETURN_IF_ERROR(CheckMayReport(record));
    return writer.AppendEvidence(evidence);
  };
  MAPP_RETURN_IF_ERROR(store_.Write(context, append));
  return stored;
}

}  // namespace mapp
