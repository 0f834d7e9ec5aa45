#pragma once

#include "mapp/base/status.h"

#include <string>

struct sqlite3;

namespace mapp::sqlite {

/// The Status for an extended SQLite result code, "operation: what happened". `db` gives SQLite's own words where the
/// code says little; it may be null. Names no path and no SQL, so it may cross the wire.
///   full disk, no memory, too big     RESOURCE_EXHAUSTED
///   corrupt page, not a database      DATA_LOSS; a page with a wrong checksum is named, see checksum_vfs.h
///   locked past the timeout, I/O      UNAVAILABLE
///   read-only, no permission          FAILED_PRECONDITION
///   interrupted                       CANCELLED
///   anything else                     INTERNAL
Status SqliteError(int extended_code, const std::string& operation, sqlite3* db);

}  // namespace mapp::sqlite
