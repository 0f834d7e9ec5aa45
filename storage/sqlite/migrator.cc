#include "storage/sqlite/migrator.h"

#include "storage/sqlite/errors.h"

#include <fmt/format.h>
#include <sqlite3.h>

#include <filesystem>
#include <system_error>

namespace mapp::sqlite {
namespace {

Status CheckApplication(Connection& db, int64_t* version) {
  MAPP_ASSIGN_OR_RETURN(const int64_t application, db.QueryInt64("PRAGMA application_id"));
  MAPP_ASSIGN_OR_RETURN(*version, db.QueryInt64("PRAGMA user_version"));
  if (application == kApplicationId) return absl::OkStatus();
  // A file that was created but never got its first migration is as good as new.
  MAPP_ASSIGN_OR_RETURN(const int64_t num_objects, db.QueryInt64("SELECT count(*) FROM sqlite_schema"));
  if (application == 0 && *version == 0 && num_objects == 0) return absl::OkStatus();
  return absl::FailedPreconditionError(
      fmt::format("not a map database: it belongs to another program (application id {:#x}, expected {:#x})",
                  application, kApplicationId));
}

/// Every migration that made the database is the one of the same number in `migrations`.
Status CheckHashes(Connection& db, std::span<const Migration> migrations) {
  Statement applied = db.Prepare("SELECT version, sha256 FROM schema_migrations ORDER BY version");
  for (;;) {
    MAPP_ASSIGN_OR_RETURN(const bool has_row, applied.Step());
    if (!has_row) return absl::OkStatus();
    const int64_t version = applied.Int64(0);
    if (version < 1 || version > static_cast<int64_t>(migrations.size())) {
      return absl::DataLossError(fmt::format("schema_migrations lists an unknown migration {}", version));
    }
    const Migration& expected = migrations[static_cast<size_t>(version - 1)];
    if (applied.Bytes(1) != expected.sha256) {
      return absl::FailedPreconditionError(
          fmt::format("database was made by another migration {} than this program's {}", version, expected.name));
    }
  }
}

Status BackUp(Connection& db, const std::string& file, int version) {
  const std::string target = fmt::format("{}.schema-{}.backup", file, version);
  // Under another name until complete: a backup cut short must not look like one.
  const std::string unfinished = target + ".unfinished";
  std::error_code error;
  std::filesystem::remove(unfinished, error);
  MAPP_ASSIGN_OR_RETURN(std::unique_ptr<Connection> copy,
                        Connection::Open(unfinished, Connection::Mode::kCreate, std::chrono::milliseconds(0)));
  sqlite3_backup* backup = sqlite3_backup_init(copy->handle(), "main", db.handle(), "main");
  if (backup == nullptr) {
    return SqliteError(sqlite3_extended_errcode(copy->handle()), "backup before migration", copy->handle());
  }
  const int step_code = sqlite3_backup_step(backup, -1);
  const int finish_code = sqlite3_backup_finish(backup);
  if (step_code != SQLITE_DONE) {
    return SqliteError(finish_code != SQLITE_OK ? finish_code : step_code, "backup before migration", copy->handle());
  }
  copy.reset();
  std::filesystem::rename(unfinished, target, error);
  if (error) return absl::UnavailableError(fmt::format("backup before migration: {}", error.message()));
  return absl::OkStatus();
}

Status Apply(Connection& db, const Migration& migration, int64_t now_ns) {
  MAPP_ASSIGN_OR_RETURN(const auto transaction, Transaction::Begin(db, Transaction::Kind::kWrite));
  MAPP_RETURN_IF_ERROR(db.Execute(migration.sql));
  MAPP_RETURN_IF_ERROR(
      db.Prepare("INSERT INTO schema_migrations (version, name, sha256, applied_ns) VALUES (?, ?, ?, ?)")
          .Bind(migration.version, std::string_view(migration.name), std::string_view(migration.sha256), now_ns)
          .Run());
  MAPP_RETURN_IF_ERROR(db.Execute(
      fmt::format("PRAGMA user_version = {}; PRAGMA application_id = {};", migration.version, kApplicationId)));
  return transaction->Commit();
}

}  // namespace

StatusOr<int> ReadSchemaVersion(Connection& db, std::span<const Migration> migrations) {
  int64_t version = 0;
  MAPP_RETURN_IF_ERROR(CheckApplication(db, &version));
  if (version > static_cast<int64_t>(migrations.size())) {
    return absl::FailedPreconditionError(
        fmt::format("database schema {} is newer than this program's {}", version, migrations.size()));
  }
  if (version > 0) MAPP_RETURN_IF_ERROR(CheckHashes(db, migrations));
  return static_cast<int>(version);
}

Status Migrate(Connection& db, const std::string& file, std::span<const Migration> migrations,
               const MigrateOptions& options) {
  MAPP_ASSIGN_OR_RETURN(const int version, ReadSchemaVersion(db, migrations));
  const auto missing = migrations.subspan(static_cast<size_t>(version));
  if (!missing.empty() && version > 0 && options.backup) MAPP_RETURN_IF_ERROR(BackUp(db, file, version));
  for (const Migration& migration : missing) {
    Status status = Apply(db, migration, options.now_ns);
    if (!status.ok()) return Annotate(status, fmt::format("migration {}", migration.name));
  }
  return absl::OkStatus();
}

}  // namespace mapp::sqlite
