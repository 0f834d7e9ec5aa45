#pragma once

#include "mapp/base/status.h"
#include "storage/records.h"
#include "storage/sqlite/change_ledger.h"
#include "storage/sqlite/connection.h"

#include <optional>
#include <string>
#include <vector>

namespace mapp::sqlite {

// What devices report of a map's points, and what was derived from it. Promises: storage/map_store.h.

StatusOr<std::vector<EvidenceRecord>> ListEvidence(Connection& db, SessionId session);
StatusOr<bool> HasEvidence(Connection& db, SessionId session, uint32_t number);
StatusOr<std::optional<std::string>> FindFindings(Connection& db, SessionId session);

Status AppendEvidence(Connection& db, ChangeLedger& ledger, const EvidenceRecord& evidence);
Status PutFindings(Connection& db, ChangeLedger& ledger, SessionId session, const std::string& findings);
Status DropFindings(Connection& db, MapId map);

}  // namespace mapp::sqlite
