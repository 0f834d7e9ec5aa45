#include "storage/sqlite/copy_database.h"

#include "storage/sqlite/checksum_vfs.h"
#include "storage/sqlite/errors.h"
#include "storage/sqlite/interrupter.h"
#include "storage/sqlite/migrator.h"

#include <fmt/format.h>
#include <sqlite3.h>

#include <filesystem>
#include <memory>
#include <system_error>

namespace mapp::sqlite {
namespace {

/// Refused at once, instead of filling the disk that the source may need itself.
Status CheckRoom(const std::string& file, int64_t num_bytes) {
  std::error_code error;
  const std::filesystem::path folder = std::filesystem::path(file).parent_path();
  const std::filesystem::space_info space = std::filesystem::space(folder.empty() ? "." : folder, error);
  if (error || static_cast<uint64_t>(num_bytes) <= space.available) return absl::OkStatus();
  return absl::ResourceExhaustedError(fmt::format("disk full: {} needs {} MB, and {} MB are free", file,
                                                  num_bytes / 1'000'000 + 1, space.available / 1'000'000));
}

struct FinishBackup {
  void operator()(sqlite3_backup* backup) const { sqlite3_backup_finish(backup); }
};

Status CopyPages(const CallContext& context, Connection& source, Connection& copy, int64_t page_bytes,
                 const CopyOptions& options) {
  std::unique_ptr<sqlite3_backup, FinishBackup> backup(
      sqlite3_backup_init(copy.handle(), "main", source.handle(), "main"));
  if (backup == nullptr) return SqliteError(sqlite3_extended_errcode(copy.handle()), "copy", copy.handle());
  int code = SQLITE_OK;
  while (code == SQLITE_OK) {
    MAPP_RETURN_IF_ERROR(context.Check());
    code = sqlite3_backup_step(backup.get(), options.pages_per_step);
    const int64_t num_pages = sqlite3_backup_pagecount(backup.get());
    const int64_t num_copied = num_pages - sqlite3_backup_remaining(backup.get());
    const bool is_good = code == SQLITE_OK || code == SQLITE_DONE;
    if (is_good && options.on_progress) {
      options.on_progress({.bytes_done = num_copied * page_bytes, .bytes_total = num_pages * page_bytes});
    }
  }
  const int finish_code = sqlite3_backup_finish(backup.release());
  if (code == SQLITE_DONE) code = finish_code == SQLITE_OK ? SQLITE_OK : finish_code;
  // The damaged page is one of the file that is read; what has just been written is not read back.
  return SqliteError(code, "copy", code == SQLITE_IOERR_DATA ? source.handle() : copy.handle());
}

Status CheckCopy(const CallContext& context, Connection& copy, int64_t version) {
  MAPP_ASSIGN_OR_RETURN(const int64_t application, copy.QueryInt64("PRAGMA application_id"));
  MAPP_ASSIGN_OR_RETURN(const int64_t copied_version, copy.QueryInt64("PRAGMA user_version"));
  if (application != kApplicationId || copied_version != version) {
    return absl::DataLossError(fmt::format("the copy has application id {:#x} and schema {}, expected {:#x} and {}",
                                           application, copied_version, kApplicationId, version));
  }
  return CheckSound(context, copy, Thoroughness::kQuick);
}

}  // namespace

StatusOr<int64_t> CopyDatabase(const CallContext& context, Connection& source, StagedFile& copy,
                               const CopyOptions& options) {
  // SQLite begins a copy anew whenever another connection has committed between two steps: under uploads, for ever. Not
  // so inside a read transaction: its snapshot stays what it is while the write-ahead log grows behind it.
  MAPP_ASSIGN_OR_RETURN(std::unique_ptr<Transaction> snapshot,
                        Transaction::Begin(source, Transaction::Kind::kSnapshot));
  MAPP_ASSIGN_OR_RETURN(const int64_t version, source.QueryInt64("PRAGMA user_version"));
  MAPP_ASSIGN_OR_RETURN(const int64_t page_bytes, source.QueryInt64("PRAGMA page_size"));
  MAPP_ASSIGN_OR_RETURN(const int64_t num_pages, source.QueryInt64("PRAGMA page_count"));
  const int64_t num_bytes = num_pages * page_bytes;
  MAPP_RETURN_IF_ERROR(CheckRoom(copy.path(), num_bytes));

  MAPP_ASSIGN_OR_RETURN(const std::unique_ptr<Connection> db,
                        Connection::Open(copy.path(), Connection::Mode::kReadWrite, std::chrono::milliseconds(0)));
  // A copy that fails is removed, and one that does not is synced once: neither needs a journal on disk.
  MAPP_RETURN_IF_ERROR(
      db->Execute("PRAGMA journal_mode = MEMORY; PRAGMA synchronous = OFF; PRAGMA locking_mode = EXCLUSIVE;"));
  if (options.max_pages > 0) {
    MAPP_RETURN_IF_ERROR(db->Execute(fmt::format("PRAGMA max_page_count = {};", options.max_pages)));
  }
  MAPP_RETURN_IF_ERROR(FollowChecksums(source, *db));
  MAPP_RETURN_IF_ERROR(CopyPages(context, source, *db, page_bytes, options));
  snapshot.reset();
  // The pages say "write-ahead log": a file that says so cannot be read where nothing can be written beside it.
  MAPP_RETURN_IF_ERROR(db->Execute("PRAGMA journal_mode = DELETE;"));
  if (options.check) {
    if (options.on_progress) {
      options.on_progress({.checking = true, .bytes_done = num_bytes, .bytes_total = num_bytes});
    }
    MAPP_RETURN_IF_ERROR(CheckCopy(context, *db, version));
  }
  return num_bytes;
}

Status CheckSound(const CallContext& context, Connection& db, Thoroughness thoroughness) {
  MAPP_RETURN_IF_ERROR(context.Check());
  const Interrupter interrupter(context, db);
  TakeReadError(db.handle());
  Statement check =
      db.Prepare(thoroughness == Thoroughness::kQuick ? "PRAGMA quick_check(1)" : "PRAGMA integrity_check(1)");
  const StatusOr<bool> row = check.Step();
  if (!row.ok()) {
    MAPP_RETURN_IF_ERROR(context.Check());
    return row.status();
  }
  const std::string finding(*row ? check.Bytes(0) : "no answer");
  if (finding == "ok") return absl::OkStatus();
  // An interrupted check may end early with a finding that is none; and what cannot be read need not be damaged.
  MAPP_RETURN_IF_ERROR(context.Check());
  MAPP_RETURN_IF_ERROR(SqliteError(TakeReadError(db.handle()), "check", db.handle()));
  return absl::DataLossError(fmt::format("damaged: {}", finding.substr(finding.rfind('\n') + 1)));
}

}  // namespace mapp::sqlite
