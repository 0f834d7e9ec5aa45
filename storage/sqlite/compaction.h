#pragma once

#include "mapp/base/status.h"
#include "storage/sqlite/change_ledger.h"
#include "storage/sqlite/connection.h"

#include <cstdint>

namespace mapp::sqlite {

// Letting go of history. Promises: storage/map_store.h.

StatusOr<int64_t> CountHistory(Connection& db, MapId map, Revision oldest);
StatusOr<int64_t> DropHistory(Connection& db, ChangeLedger& ledger, MapId map, Revision oldest, int64_t max_rows);
StatusOr<int64_t> GiveBackSpace(Connection& db, int64_t max_bytes);

}  // namespace mapp::sqlite
