#include "storage/sqlite/backup.h"

#include "storage/sqlite/copy_database.h"
#include "storage/sqlite/database_file.h"
#include "storage/sqlite/migrator.h"
#include "storage/sqlite/staged_file.h"

#include <fmt/chrono.h>
#include <fmt/format.h>

#include <algorithm>
#include <array>
#include <filesystem>
#include <string_view>
#include <system_error>

namespace mapp {
namespace sqlite {
namespace {

namespace fs = std::filesystem;

constexpr std::string_view kBackupSuffix = ".db";
constexpr std::string_view kTimestampShape = "00000000T000000Z";

/// Whether `text` looks like a FileTimestamp.
bool IsTimestamp(std::string_view text) {
  if (text.size() != kTimestampShape.size()) return false;
  for (size_t i = 0; i < text.size(); ++i) {
    const bool is_digit = text[i] >= '0' && text[i] <= '9';
    if (kTimestampShape[i] == '0' ? !is_digit : text[i] != kTimestampShape[i]) return false;
  }
  return true;
}

/// Whether `file` is called as a backup of the database `name` in a folder is.
bool IsBackupName(std::string_view file, std::string_view name) {
  const size_t num_around = name.size() + 1 + kBackupSuffix.size();
  if (file.size() <= num_around || !file.starts_with(name) || file[name.size()] != '-') return false;
  return file.ends_with(kBackupSuffix) && IsTimestamp(file.substr(name.size() + 1, file.size() - num_around));
}

/// A file of this name would be taken for another one's companion.
Status CheckTargetName(const std::string& file) {
  constexpr std::array<std::string_view, 5> kTaken = {kWalSuffix, kJournalSuffix, kSharedMemorySuffix, ".lock",
                                                      ".unfinished"};
  for (const std::string_view suffix : kTaken) {
    if (!file.ends_with(suffix)) continue;
    return absl::InvalidArgumentError(
        fmt::format("{}: a backup cannot be called *{}, as SQLite or the server means something by it", file, suffix));
  }
  return absl::OkStatus();
}

/// The file to write; `*rotated` is the folder when one was named.
StatusOr<std::string> ChooseTarget(const std::string& database, const BackupOptions& options, fs::path* rotated) {
  if (options.to.empty()) return absl::InvalidArgumentError("a backup needs a file or a folder to go to");
  if (options.num_kept < 0) return absl::InvalidArgumentError("the number of backups to keep cannot be negative");
  std::error_code error;
  const fs::path to = fs::absolute(options.to, error).lexically_normal();
  if (error) return absl::FailedPreconditionError(fmt::format("{}: {}", options.to, error.message()));
  if (fs::is_directory(to, error)) {
    *rotated = to;
    const std::string name = fs::path(database).stem().string();
    return (to / fmt::format("{}-{}{}", name, FileTimestamp(options.now), kBackupSuffix)).string();
  }
  if (!to.has_filename()) return absl::NotFoundError(fmt::format("{}: there is no such folder", to.string()));
  if (options.num_kept > 0) {
    return absl::InvalidArgumentError(
        fmt::format("{} is no folder: old backups can only be deleted in a folder", to.string()));
  }
  if (!fs::is_directory(to.parent_path(), error)) {
    return absl::NotFoundError(fmt::format("folder {} does not exist", to.parent_path().string()));
  }
  MAPP_RETURN_IF_ERROR(CheckTargetName(to.string()));
  return to.string();
}

/// All but the newest `num_kept` backups of the folder, of which `made` is one whatever the clock says. Oldest first.
StatusOr<std::vector<std::string>> OldBackups(const fs::path& folder, const std::string& name, const std::string& made,
                                              int num_kept) {
  std::vector<std::string> others;
  std::error_code error;
  for (fs::directory_iterator entry(folder, error), end; !error && entry != end; entry.increment(error)) {
    std::error_code ignored;  // one that has gone meanwhile is no regular file
    const bool is_regular = fs::is_regular_file(entry->symlink_status(ignored));
    const std::string file = entry->path().string();
    if (is_regular && file != made && IsBackupName(entry->path().filename().string(), name)) others.push_back(file);
  }
  if (error) return absl::FailedPreconditionError(fmt::format("{}: {}", folder.string(), error.message()));
  std::sort(others.begin(), others.end());
  const size_t num_others_kept = static_cast<size_t>(num_kept - 1);
  others.resize(others.size() - std::min(others.size(), num_others_kept));
  return others;
}

Status Delete(const std::vector<std::string>& files) {
  std::error_code error;
  for (const std::string& file : files) {
    fs::remove(file, error);
    if (error) return absl::FailedPreconditionError(fmt::format("{}: {}", file, error.message()));
  }
  return absl::OkStatus();
}

StatusOr<Backup> BackUp(const CallContext& context, const std::string& database, const BackupOptions& options) {
  MAPP_ASSIGN_OR_RETURN(const std::string file, ResolveFile(database, /*must_exist=*/true));
  MAPP_ASSIGN_OR_RETURN(const std::unique_ptr<Connection> source, OpenForReading(file, {}));
  Backup backup;
  MAPP_ASSIGN_OR_RETURN(backup.schema_version, ReadSchemaVersion(*source, EmbeddedMigrations()));
  if (backup.schema_version == 0) return absl::FailedPreconditionError("not a map database: it is empty");

  fs::path rotated;
  MAPP_ASSIGN_OR_RETURN(backup.file, ChooseTarget(file, options, &rotated));
  std::error_code error;
  if (fs::exists(fs::symlink_status(backup.file, error))) {
    return absl::AlreadyExistsError(fmt::format("{} is there already", backup.file));
  }
  const auto old_backups = [&]() -> StatusOr<std::vector<std::string>> {
    if (options.num_kept == 0) return std::vector<std::string>();
    return OldBackups(rotated, fs::path(file).stem().string(), backup.file, options.num_kept);
  };
  if (options.dry_run) {
    backup.num_bytes = static_cast<int64_t>(fs::file_size(file, error));
    if (error) return absl::FailedPreconditionError(error.message());
    MAPP_ASSIGN_OR_RETURN(backup.deleted, old_backups());
    return backup;
  }
  MAPP_ASSIGN_OR_RETURN(const std::unique_ptr<StagedFile> copy, StagedFile::Create(backup.file));
  MAPP_RETURN_IF_ERROR(copy->TakePermissions(file));
  MAPP_ASSIGN_OR_RETURN(backup.num_bytes, CopyDatabase(context, *source, *copy,
                                                       {.pages_per_step = options.pages_per_step,
                                                        .max_pages = options.max_pages,
                                                        .on_progress = options.on_progress}));
  MAPP_RETURN_IF_ERROR(copy->Commit(StagedFile::Existing::kRefuse));
  StatusOr<std::vector<std::string>> old = old_backups();
  const Status deleted = old.ok() ? Delete(*old) : old.status();
  if (!deleted.ok()) {
    return Annotate(deleted, fmt::format("{} is made, but older ones could not be deleted", backup.file));
  }
  backup.deleted = *std::move(old);
  return backup;
}

}  // namespace
}  // namespace sqlite

StatusOr<Backup> BackUpDatabase(const CallContext& context, const std::string& database, const BackupOptions& options) {
  return sqlite::BackUp(context, database, options);
}

std::string FileTimestamp(std::chrono::system_clock::time_point time) {
  return fmt::format("{:%Y%m%dT%H%M%SZ}", fmt::gmtime(std::chrono::system_clock::to_time_t(time)));
}

}  // namespace mapp
