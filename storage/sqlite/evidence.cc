#include "storage/sqlite/evidence.h"

#include "mapp/base/bytes.h"
#include "storage/checks.h"
#include "storage/sqlite/catalog.h"
#include "storage/sqlite/rows.h"

#include <fmt/format.h>

namespace mapp::sqlite {
namespace {

/// Columns: session, number, time received, packet, its checksum.
StatusOr<EvidenceRecord> ReadEvidence(const Statement& row) {
  EvidenceRecord evidence;
  evidence.session = row.GetId<SessionId>(0);
  evidence.number = static_cast<uint32_t>(row.Int64(1));
  evidence.received_ns = row.Int64(2);
  evidence.packet = row.Bytes(3);
  if (const uint32_t crc = Crc32c(evidence.packet); crc != row.Int64(4)) {
    return absl::DataLossError(fmt::format("evidence {} of session {}: crc32c {:#010x} != stored {:#010x}",
                                           evidence.number, evidence.session.value(), crc, row.Int64(4)));
  }
  return evidence;
}

}  // namespace

StatusOr<std::vector<EvidenceRecord>> ListEvidence(Connection& db, SessionId session) {
  Statement query = db.Prepare(
      "SELECT session_id, number, received_ns, packet, crc32c FROM evidence WHERE session_id = ? ORDER BY number");
  query.Bind(session);
  return ReadAll(query, ReadEvidence);
}

StatusOr<bool> HasEvidence(Connection& db, SessionId session, uint32_t number) {
  Statement query = db.Prepare("SELECT 1 FROM evidence WHERE session_id = ? AND number = ?");
  return query.Bind(session, number).Step();
}

StatusOr<std::optional<std::string>> FindFindings(Connection& db, SessionId session) {
  Statement query = db.Prepare("SELECT blob, crc32c FROM findings WHERE session_id = ?");
  MAPP_ASSIGN_OR_RETURN(const bool has_row, query.Bind(session).Step());
  if (!has_row) return std::nullopt;
  std::string findings(query.Bytes(0));
  if (const uint32_t crc = Crc32c(findings); crc != query.Int64(1)) {
    return absl::DataLossError(fmt::format("findings of session {}: crc32c {:#010x} != stored {:#010x}",
                                           session.value(), crc, query.Int64(1)));
  }
  return findings;
}

Status AppendEvidence(Connection& db, ChangeLedger& ledger, const EvidenceRecord& evidence) {
  MAPP_RETURN_IF_ERROR(ledger.MapOfSession(evidence.session).status());
  MAPP_ASSIGN_OR_RETURN(const bool is_stored, HasEvidence(db, evidence.session, evidence.number));
  if (is_stored) return internal::EvidenceIsStored(evidence);
  return db.Prepare("INSERT INTO evidence (session_id, number, received_ns, crc32c, packet) VALUES (?, ?, ?, ?, ?)")
      .Bind(evidence.session, evidence.number, evidence.received_ns != 0 ? evidence.received_ns : ledger.now_ns(),
            Crc32c(evidence.packet), Blob{evidence.packet})
      .Run();
}

Status PutFindings(Connection& db, ChangeLedger& ledger, SessionId session, const std::string& findings) {
  MAPP_RETURN_IF_ERROR(ledger.MapOfSession(session).status());
  return db.Prepare("INSERT OR REPLACE INTO findings (session_id, crc32c, blob) VALUES (?, ?, ?)")
      .Bind(session, Crc32c(findings), Blob{findings})
      .Run();
}

Status DropFindings(Connection& db, MapId map) {
  MAPP_RETURN_IF_ERROR(GetMap(db, map).status());
  return db.Prepare("DELETE FROM findings WHERE session_id IN (SELECT session_id FROM sessions WHERE map_id = ?)")
      .Bind(map)
      .Run();
}

}  // namespace mapp::sqlite
