// Evidence, findings and changes of the world: their half of MapWriter.
#include "storage/checks.h"
#include "storage/memory/change.h"

namespace mapp::memory {

Status Change::AppendEvidence(const EvidenceRecord& evidence) {
  const MapState* const map = contents_.MapOfSession(evidence.session);
  if (map == nullptr) return internal::NoSuchSession(evidence.session);
  const std::pair key(evidence.session, evidence.number);
  if (map->evidence.Find(key) != nullptr) return internal::EvidenceIsStored(evidence);
  EvidenceRecord appended = evidence;
  if (appended.received_ns == 0) appended.received_ns = now_ns_;
  Edit(map->record.id).state->evidence.Set(key, std::move(appended));
  return absl::OkStatus();
}

Status Change::PutFindings(SessionId session, const std::string& findings) {
  const MapState* const map = contents_.MapOfSession(session);
  if (map == nullptr) return internal::NoSuchSession(session);
  Edit(map->record.id).state->findings.Set(session, findings);
  return absl::OkStatus();
}

Status Change::DropFindings(MapId map) {
  if (contents_.FindMap(map) == nullptr) return internal::NoSuchMap(map);
  Edit(map).state->findings = {};
  return absl::OkStatus();
}

StatusOr<ChangeId> Change::PutChange(const ChangeRecord& change) {
  MAPP_RETURN_IF_ERROR(internal::CheckChange(change));
  if (contents_.FindMap(change.map) == nullptr) return internal::NoSuchMap(change.map);
  for (const SessionId session : change.sessions) {
    const MapState* const map = contents_.MapOfSession(session);
    if (map == nullptr) return internal::NoSuchSession(session);
    MAPP_RETURN_IF_ERROR(internal::CheckChangesSession(change, session, map->record.id));
  }
  ChangeRecord put = change;
  if (change.id == ChangeId()) {
    put.id = ChangeId(contents_.next.change++);
  } else {
    const MapState* const map = contents_.MapOfChange(change.id);
    if (map == nullptr) return internal::NoSuchChange(change.id);
    MAPP_RETURN_IF_ERROR(internal::CheckChangesMap(change, map->record.id));
  }
  Edit(change.map).state->changes.Set(put.id, put);
  return put.id;
}

Status Change::DeleteChange(ChangeId change) {
  const MapState* const map = contents_.MapOfChange(change);
  if (map == nullptr) return internal::NoSuchChange(change);
  Edit(map->record.id).state->changes.Erase(change);
  return absl::OkStatus();
}

}  // namespace mapp::memory
