#include "storage/sqlite/restore.h"

#include "storage/sqlite/copy_database.h"
#include "storage/sqlite/database_file.h"
#include "storage/sqlite/file_lock.h"
#include "storage/sqlite/migrator.h"
#include "storage/sqlite/staged_file.h"

#include <fmt/format.h>
#include <sqlite3.h>

#include <array>
#include <filesystem>
#include <fstream>
#include <string_view>
#include <system_error>

namespace mapp {
namespace sqlite {
namespace {

namespace fs = std::filesystem;

/// What may hold changes of a database that was not closed.
constexpr std::array kLogSuffixes = {kWalSuffix, kJournalSuffix};

StatusOr<std::unique_ptr<Connection>> OpenBackup(const std::string& file, int* version) {
  MAPP_ASSIGN_OR_RETURN(std::unique_ptr<Connection> db, OpenForReading(file, {}));
  MAPP_ASSIGN_OR_RETURN(*version, ReadSchemaVersion(*db, EmbeddedMigrations()));
  if (*version == 0) return absl::FailedPreconditionError("not a map database: it is empty");
  return db;
}

Status InspectBackup(const CallContext& context, RestorePlan* plan) {
  MAPP_ASSIGN_OR_RETURN(plan->backup, ResolveFile(plan->backup, /*must_exist=*/true));
  MAPP_ASSIGN_OR_RETURN(const std::unique_ptr<Connection> db, OpenBackup(plan->backup, &plan->schema_version));
  MAPP_RETURN_IF_ERROR(CheckSound(context, *db, Thoroughness::kFull));
  MAPP_ASSIGN_OR_RETURN(const int64_t num_pages, db->QueryInt64("PRAGMA page_count"));
  MAPP_ASSIGN_OR_RETURN(const int64_t page_bytes, db->QueryInt64("PRAGMA page_size"));
  plan->num_bytes = num_pages * page_bytes;
  MAPP_ASSIGN_OR_RETURN(plan->num_maps, db->QueryInt64("SELECT count(*) FROM maps"));
  MAPP_ASSIGN_OR_RETURN(plan->num_keyframes, db->QueryInt64("SELECT count(*) FROM frames"));
  return absl::OkStatus();
}

int64_t FileBytes(const std::string& file) {
  std::error_code error;
  const uintmax_t size = fs::file_size(file, error);
  return error ? 0 : static_cast<int64_t>(size);
}

/// OK for a map database, however damaged behind its first 100 bytes. Read without SQLite, which may not even open it,
/// and would touch the files beside it.
Status CheckReplaceable(const std::string& file) {
  constexpr size_t kHeaderBytes = 100;
  constexpr size_t kApplicationIdOffset = 68;
  std::ifstream stream(file, std::ios::binary);
  std::array<unsigned char, kHeaderBytes> header{};
  stream.read(reinterpret_cast<char*>(header.data()), kHeaderBytes);
  if (stream.gcount() == 0) return absl::OkStatus();
  int64_t application = 0;
  for (size_t i = 0; i < 4; ++i) application = application << 8 | header[kApplicationIdOffset + i];
  if (application == kApplicationId) return absl::OkStatus();
  // A server that was killed in its first moments has all but the first lines in the write-ahead log.
  if (application == 0 && FileBytes(file + kWalSuffix) > 0) return absl::OkStatus();
  return absl::FailedPreconditionError(
      "it is another program's, not a map database: move it away, or restore to another file");
}

Status InspectDatabase(std::chrono::system_clock::time_point now, RestorePlan* plan) {
  MAPP_ASSIGN_OR_RETURN(plan->database, ResolveFile(plan->database, /*must_exist=*/false));
  const std::string& file = plan->database;
  std::error_code error;
  // Only looks, and so makes no lock where none is.
  if (fs::exists(file + ".lock", error)) MAPP_RETURN_IF_ERROR(FileLock::Acquire(file).status());
  plan->kept_as = fmt::format("{}.before-restore-{}", file, FileTimestamp(now));
  if (fs::exists(fs::symlink_status(plan->kept_as, error))) {
    return absl::AlreadyExistsError(fmt::format("what is there cannot be kept as {}: taken", plan->kept_as));
  }
  if (!fs::exists(file, error)) return absl::OkStatus();
  MAPP_RETURN_IF_ERROR(CheckReplaceable(file));
  plan->replaced_bytes = FileBytes(file) + FileBytes(file + kWalSuffix);
  return absl::OkStatus();
}

/// Folds the write-ahead log into the database, which is one file then. FAILED_PRECONDITION when somebody has it open.
/// One that is too damaged for this stays as it is, log and all.
Status CloseDatabaseFile(const std::string& file) {
  const auto in_use = [](const Connection& db) { return (sqlite3_errcode(db.handle()) & 0xff) == SQLITE_BUSY; };
  StatusOr<std::unique_ptr<Connection>> db =
      Connection::Open(file, Connection::Mode::kReadWrite, std::chrono::milliseconds(0));
  if (!db.ok()) return absl::OkStatus();
  const Status folded = (*db)->Execute("PRAGMA journal_mode = DELETE; BEGIN EXCLUSIVE; ROLLBACK;");
  if (folded.ok() || !in_use(**db)) return absl::OkStatus();
  return absl::FailedPreconditionError("it is open in another program (a backup, a tool): wait for that to end");
}

/// Gives what is in the database's place its second name, and takes away what SQLite would replay onto the new file.
Status KeepOld(const RestorePlan& plan) {
  std::error_code error;
  const auto failed = [&] {
    return absl::FailedPreconditionError(
        fmt::format("the old one cannot be kept as {}: {}", plan.kept_as, error.message()));
  };
  if (fs::exists(plan.database, error)) {
    fs::create_hard_link(plan.database, plan.kept_as, error);
    if (error) return failed();
  }
  // There is a log only of a database that is too damaged to be closed, or that somebody has deleted. It goes before
  // the new file comes: SQLite would replay it onto that.
  for (const char* suffix : kLogSuffixes) {
    if (!fs::exists(plan.database + suffix, error)) continue;
    fs::rename(plan.database + suffix, plan.kept_as + suffix, error);
    if (error) return failed();
  }
  fs::remove(plan.database + kSharedMemorySuffix, error);
  if (error) return failed();
  return SyncFolder(fs::path(plan.database).parent_path().string());
}

Status Replace(const CallContext& context, const RestorePlan& plan, Connection& backup, const RestoreObserver& tell) {
  const bool replaces = plan.replaced_bytes.has_value();
  MAPP_ASSIGN_OR_RETURN(const std::unique_ptr<StagedFile> copy, StagedFile::Create(plan.database));
  MAPP_RETURN_IF_ERROR(copy->TakePermissions(replaces ? plan.database : plan.backup));
  if (replaces) MAPP_RETURN_IF_ERROR(copy->TakeOwner(plan.database));
  CopyOptions options;
  options.on_progress = [&](const BackupProgress& progress) {
    tell({progress.checking ? RestoreStep::kChecking : RestoreStep::kCopying, progress});
  };
  MAPP_RETURN_IF_ERROR(CopyDatabase(context, backup, *copy, options).status());
  MAPP_RETURN_IF_ERROR(copy->Sync());
  tell({RestoreStep::kClosing, {}});
  if (replaces) MAPP_RETURN_IF_ERROR(CloseDatabaseFile(plan.database));
  tell({RestoreStep::kKeeping, {}});
  MAPP_RETURN_IF_ERROR(KeepOld(plan));
  tell({RestoreStep::kReplacing, {}});
  return copy->Commit(StagedFile::Existing::kReplace);
}

}  // namespace
}  // namespace sqlite

StatusOr<RestorePlan> PlanRestore(const CallContext& context, const std::string& backup, const std::string& database,
                                  std::chrono::system_clock::time_point now) {
  RestorePlan plan;
  plan.backup = backup;
  plan.database = database;
  std::error_code error;
  if (std::filesystem::equivalent(backup, database, error)) {
    return absl::InvalidArgumentError(fmt::format("{}: is the database itself, not a backup", backup));
  }
  // What takes no time first.
  MAPP_RETURN_IF_ERROR(Annotate(sqlite::InspectDatabase(now, &plan), database));
  MAPP_RETURN_IF_ERROR(Annotate(sqlite::InspectBackup(context, &plan), backup));
  return plan;
}

Status Restore(const CallContext& context, const RestorePlan& plan, const RestoreObserver& on_progress) {
  const RestoreObserver tell = on_progress ? on_progress : [](const RestoreProgress&) {};
  int version = 0;
  const StatusOr<std::unique_ptr<sqlite::Connection>> backup = sqlite::OpenBackup(plan.backup, &version);
  if (!backup.ok()) return Annotate(backup.status(), plan.backup);
  MAPP_ASSIGN_OR_RETURN(const std::unique_ptr<sqlite::FileLock> lock, sqlite::FileLock::Acquire(plan.database));
  return Annotate(sqlite::Replace(context, plan, **backup, tell), plan.database);
}

}  // namespace mapp
