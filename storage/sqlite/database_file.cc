#include "storage/sqlite/database_file.h"

#include "storage/sqlite/checksum_vfs.h"
#include "storage/sqlite/migrator.h"
#include "storage/sqlite/staged_file.h"

#include <fmt/format.h>

#include <cerrno>
#include <cstring>
#include <fcntl.h>
#include <filesystem>
#include <fstream>
#include <string_view>
#include <system_error>
#include <unistd.h>

namespace mapp::sqlite {
namespace {

namespace fs = std::filesystem;

/// The write-ahead log is cut back to this size after a checkpoint, should a long reader have let it grow.
constexpr int64_t kJournalSizeLimitBytes = 64 << 20;

Status SetCommonPragmas(Connection& db, int cache_kb) {
  // A negative cache size is in KiB. secure_delete is on by default in Debian's build and would write every freed page.
  // temp_store stays at its default: kept in memory, the journal of a savepoint is a list that SQLite walks from its
  // beginning at the end of every statement, which takes most of the time of a change of some thousand pages.
  return db.Execute(
      fmt::format("PRAGMA cache_size = -{}; PRAGMA secure_delete = OFF; PRAGMA cell_size_check = ON;", cache_kb));
}

/// Settings that only count while the file is still empty.
Status SetCreationPragmas(Connection& db, const SqliteOptions& options) {
  MAPP_RETURN_IF_ERROR(db.Execute(fmt::format("PRAGMA page_size = {};", options.page_size_bytes)));
  if (options.page_checksums) ReserveTrailer(db);
  return db.Execute("PRAGMA auto_vacuum = INCREMENTAL;");
}

Status SetWriterPragmas(Connection& db, const SqliteOptions& options) {
  MAPP_RETURN_IF_ERROR(db.Execute(fmt::format(
      "PRAGMA journal_mode = WAL; PRAGMA synchronous = {}; PRAGMA foreign_keys = ON; PRAGMA journal_size_limit = {};",
      options.sync_commits ? "FULL" : "NORMAL", kJournalSizeLimitBytes)));
  if (options.max_pages > 0) {
    MAPP_RETURN_IF_ERROR(db.Execute(fmt::format("PRAGMA max_page_count = {};", options.max_pages)));
  }
  return absl::OkStatus();
}

/// SQLite itself would only say "cannot open".
Status CheckAccess(const std::string& file, int mode) {
  if (faccessat(AT_FDCWD, file.c_str(), mode, AT_EACCESS) == 0 || errno == ENOENT) return absl::OkStatus();
  return absl::FailedPreconditionError(std::strerror(errno));
}

/// An absent or empty file is a database that has yet to be created.
Status CheckIsDatabase(const std::string& file) {
  constexpr std::string_view kMagic("SQLite format 3\0", 16);
  constexpr std::string_view kApplication("Mapp");
  constexpr size_t kApplicationOffset = 68;
  std::ifstream stream(file, std::ios::binary);
  std::string header(kApplicationOffset + kApplication.size(), '\0');
  stream.read(header.data(), static_cast<std::streamsize>(header.size()));
  if (stream.gcount() == 0 || header.starts_with(kMagic)) return absl::OkStatus();
  // A power cut in the first moments of a database may leave a hole, and the journal with which SQLite takes it back.
  const bool is_hole = header.find_first_not_of('\0') == std::string::npos;
  std::error_code none;
  if (is_hole && fs::exists(file + kJournalSuffix, none)) return absl::OkStatus();
  if (header.ends_with(kApplication)) {
    return absl::DataLossError("page 1 is damaged (the file does not begin as a database does): restore a backup");
  }
  return absl::FailedPreconditionError("not a map database: the file is no SQLite database");
}

}  // namespace

StatusOr<std::string> ResolveFile(const std::string& file, bool must_exist) {
  std::error_code error;
  const fs::path path = fs::weakly_canonical(fs::absolute(file, error), error);
  if (error) return absl::FailedPreconditionError(error.message());
  const fs::file_status status = fs::status(path, error);
  if (fs::exists(status)) {
    if (!fs::is_regular_file(status)) return absl::FailedPreconditionError("not a regular file");
    MAPP_RETURN_IF_ERROR(CheckIsDatabase(path.string()));
    return path.string();
  }
  if (must_exist) return absl::NotFoundError("no such file");
  if (!fs::is_directory(path.parent_path(), error)) {
    return absl::NotFoundError(fmt::format("folder {} does not exist", path.parent_path().string()));
  }
  return path.string();
}

StatusOr<std::unique_ptr<Connection>> OpenForWriting(const std::string& file, const SqliteOptions& options) {
  MAPP_RETURN_IF_ERROR(CheckAccess(file, R_OK | W_OK));
  MAPP_ASSIGN_OR_RETURN(std::unique_ptr<Connection> db,
                        Connection::Open(file, Connection::Mode::kCreate, options.busy_timeout));
  MAPP_RETURN_IF_ERROR(SetCommonPragmas(*db, options.writer_cache_kb));
  // Before anything is written, so that a file that is not ours stays untouched.
  MAPP_ASSIGN_OR_RETURN(const int version, ReadSchemaVersion(*db, EmbeddedMigrations()));
  if (version == 0) MAPP_RETURN_IF_ERROR(SetCreationPragmas(*db, options));
  MAPP_RETURN_IF_ERROR(SetWriterPragmas(*db, options));
  MAPP_RETURN_IF_ERROR(Migrate(*db, file, EmbeddedMigrations(),
                               {.backup = options.backup_before_migration, .now_ns = options.unix_now_ns()}));
  return db;
}

StatusOr<std::unique_ptr<Connection>> OpenForReading(const std::string& file, const SqliteOptions& options) {
  MAPP_RETURN_IF_ERROR(CheckAccess(file, R_OK));
  MAPP_ASSIGN_OR_RETURN(std::unique_ptr<Connection> db,
                        Connection::Open(file, Connection::Mode::kReadOnly, options.busy_timeout));
  MAPP_RETURN_IF_ERROR(SetCommonPragmas(*db, options.reader_cache_kb));
  return db;
}

Status CheckSchemaIsCurrent(Connection& db) {
  MAPP_ASSIGN_OR_RETURN(const int version, ReadSchemaVersion(db, EmbeddedMigrations()));
  const int current = static_cast<int>(EmbeddedMigrations().size());
  if (version == current) return absl::OkStatus();
  return absl::FailedPreconditionError(
      version == 0 ? std::string("not a map database: it is empty")
                   : fmt::format("database schema {} is older than this program's {}: start a server on it once",
                                 version, current));
}

}  // namespace mapp::sqlite
