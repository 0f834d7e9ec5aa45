#include "storage/sqlite/migrator.h"

#include "storage/sqlite/copy_database.h"
#include "storage/sqlite/staged_file.h"

#include <fmt/format.h>

#include <memory>

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

Status BackUpSchema(Connection& db, const std::string& file, int version) {
  MAPP_ASSIGN_OR_RETURN(const std::unique_ptr<StagedFile> copy,
                        StagedFile::Create(fmt::format("{}.schema-{}.backup", file, version)));
  MAPP_RETURN_IF_ERROR(copy->TakePermissions(file));
  // Sound or not: this one only takes the migration back.
  MAPP_RETURN_IF_ERROR(CopyDatabase({}, db, *copy, {.check = false}).status());
  return copy->Commit(StagedFile::Existing::kReplace);
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
  if (!missing.empty() && version > 0 && options.backup) {
    MAPP_RETURN_IF_ERROR(Annotate(BackUpSchema(db, file, version), "backup before migration"));
  }
  for (const Migration& migration : missing) {
    Status status = Apply(db, migration, options.now_ns);
    if (!status.ok()) return Annotate(status, fmt::format("migration {}", migration.name));
  }
  return absl::OkStatus();
}

}  // namespace mapp::sqlite
