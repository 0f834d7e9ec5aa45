#pragma once

#include "mapp/base/status.h"

#include <cstdint>
#include <optional>

struct sqlite3;

namespace mapp::sqlite {

class Connection;

/// Bytes at the end of every page of a database with checksums (docs/formats/database.md).
inline constexpr int kPageTrailerBytes = 8;

/// Name of the SQLite VFS that every map database is opened with: the system's own, but in a database with checksums
/// each page gets its checksum when it is written to the main file and is checked when it is read from there. A page
/// that does not match is SQLITE_IOERR_DATA, see LastDamagedPage. A database without checksums passes unchecked.
const char* ChecksumVfsName();

/// Lets a database that has yet to be created begin with checksums. Between `PRAGMA page_size`, which forgets it, and
/// `PRAGMA auto_vacuum`, after which it is too late.
void ReserveTrailer(Connection& db);
/// Whether the pages of the database, as the connection sees it, end with checksums.
bool HasChecksums(Connection& db);
/// Lets `copy`, an empty file that is to become `source` page by page, get its checksums when `source` has them: SQLite
/// may write the first page, which tells, after others.
Status FollowChecksums(Connection& source, Connection& copy);
/// Gives a database without checksums its checksums by writing it anew (VACUUM): takes its size again in the
/// write-ahead log, and all writers wait. It is as it was until that is complete. Nothing happens to one that has them.
Status EnableChecksums(Connection& db);

/// Number of the page, from 1, whose checksum was wrong when this connection last met one.
std::optional<uint32_t> LastDamagedPage(sqlite3* db);

/// SQLite's code for the last read from the main file that failed, wrong checksums included; SQLITE_OK (0) when none
/// has since this connection was last asked. SQLite's checks of a database say no more than that a page cannot be had.
int TakeReadError(sqlite3* db);

}  // namespace mapp::sqlite
