#pragma once

#include "mapp/base/status.h"
#include "storage/records.h"
#include "storage/sqlite/change_ledger.h"
#include "storage/sqlite/connection.h"

#include <vector>

namespace mapp::sqlite {

// Changes of the world that a map's history tells of. Promises: storage/map_store.h.

StatusOr<std::vector<ChangeRecord>> ListChanges(Connection& db, MapId map);
StatusOr<ChangeRecord> GetChange(Connection& db, ChangeId change);

StatusOr<ChangeId> PutChange(Connection& db, ChangeLedger& ledger, const ChangeRecord& change);
Status DeleteChange(Connection& db, ChangeId change);
/// The map's changes rest on the session no more; those that rest on nothing else are deleted.
Status EraseFromChanges(Connection& db, MapId map, SessionId session);

}  // namespace mapp::sqlite
