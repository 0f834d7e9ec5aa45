#include "storage/sqlite/errors.h"

#include "storage/sqlite/checksum_vfs.h"

#include <fmt/format.h>
#include <sqlite3.h>

#include <optional>
#include <string_view>

namespace mapp::sqlite {
namespace {

/// Without its folder, which is nobody's business on the wire.
std::string_view FileName(sqlite3* db) {
  const char* file = sqlite3_db_filename(db, "main");
  if (file == nullptr) return "the database";
  const std::string_view path(file);
  return path.substr(path.rfind('/') + 1);
}

Status DamagedPage(const std::string& operation, sqlite3* db) {
  const std::optional<uint32_t> page = db != nullptr ? LastDamagedPage(db) : std::nullopt;
  if (!page) return absl::DataLossError(fmt::format("{}: a page is damaged", operation));
  return absl::DataLossError(fmt::format("{}: page {} of {} is damaged (its checksum is wrong): restore a backup",
                                         operation, *page, FileName(db)));
}

Status IoError(int extended_code, const std::string& message) {
  switch (extended_code) {
    case SQLITE_IOERR_SHORT_READ:
    case SQLITE_IOERR_CORRUPTFS:
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
      if (extended_code == SQLITE_IOERR_DATA) return DamagedPage(operation, db);
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
