#include "storage/sqlite/errors.h"

#include <fmt/format.h>
#include <sqlite3.h>

namespace mapp::sqlite {
namespace {

Status IoError(int extended_code, const std::string& message) {
  switch (extended_code) {
    case SQLITE_IOERR_SHORT_READ:
    case SQLITE_IOERR_CORRUPTFS:
    case SQLITE_IOERR_DATA:
      return absl::DataLossError(message);
    case SQLITE_IOERR_NOMEM:
      return absl::ResourceExhaustedError(message);
    default:
      return absl::UnavailableError(message);
  }
}

}  // namespace

Status SqliteError(int extended_code, const std::string& operation, sqlite3* db) {
  const auto message = [&](const char* what) {
    return fmt::format("{}: {} (SQLite code {})", operation, what, extended_code);
  };
  switch (extended_code & 0xff) {
    case SQLITE_OK:
      return absl::OkStatus();
    case SQLITE_FULL:
      return absl::ResourceExhaustedError(message("disk full"));
    case SQLITE_NOMEM:
      return absl::ResourceExhaustedError(message("out of memory"));
    case SQLITE_TOOBIG:
      return absl::ResourceExhaustedError(message("value too big for the database"));
    case SQLITE_CORRUPT:
      return absl::DataLossError(message("database is corrupt"));
    case SQLITE_NOTADB:
      return absl::DataLossError(message("file is not a database"));
    case SQLITE_IOERR:
      return IoError(extended_code, message("I/O error"));
    case SQLITE_BUSY:
    case SQLITE_LOCKED:
      return absl::UnavailableError(message("database is locked"));
    case SQLITE_CANTOPEN:
      return absl::UnavailableError(message("cannot open the file"));
    case SQLITE_READONLY:
      return absl::FailedPreconditionError(message("database is read-only"));
    case SQLITE_PERM:
    case SQLITE_AUTH:
      return absl::FailedPreconditionError(message("permission denied"));
    case SQLITE_INTERRUPT:
      return absl::CancelledError(message("interrupted"));
    default:
      return absl::InternalError(message(db != nullptr ? sqlite3_errmsg(db) : sqlite3_errstr(extended_code)));
  }
}

}  // namespace mapp::sqlite
