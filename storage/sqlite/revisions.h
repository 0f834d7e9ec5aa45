#pragma once

#include "mapp/base/status.h"
#include "storage/records.h"
#include "storage/sqlite/change_ledger.h"
#include "storage/sqlite/connection.h"

#include <string>
#include <vector>

namespace mapp::sqlite {

// Revisions, their names, and what lies between them. Promises: storage/map_store.h.

/// OUT_OF_RANGE when the map has not, or no longer, the state of `revision`; NOT_FOUND: no such map.
Status CheckRevision(Connection& db, MapId map, Revision revision);
StatusOr<std::vector<RevisionRecord>> ListRevisions(Connection& db, MapId map, Revision first, Revision last);
StatusOr<std::vector<TagRecord>> ListTags(Connection& db, MapId map);
StatusOr<std::vector<SessionDiff>> DiffRevisions(Connection& db, MapId map, Revision from, Revision to);

Status PutTag(Connection& db, ChangeLedger& ledger, MapId map, const std::string& name, Revision revision);
Status DeleteTag(Connection& db, MapId map, const std::string& name);

}  // namespace mapp::sqlite
