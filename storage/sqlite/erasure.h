#pragma once

#include "storage/sqlite/change_ledger.h"

namespace mapp::sqlite {

// As the MapWriter members of these names.
Status AdoptPoint(Connection& db, ChangeLedger& ledger, MapPointId point, SessionId session, uint64_t session_point,
                  const OrbDescriptor& descriptor);
Status EraseSession(Connection& db, ChangeLedger& ledger, SessionId session);

/// As MapStore::Rewrite, outside of a transaction; a database of before there were page checksums gets them.
Status Rewrite(Connection& db);

}  // namespace mapp::sqlite
