#include "server/backup_folder.h"

#include <algorithm>
#include <filesystem>
#include <system_error>

namespace mapp {
namespace {

namespace fs = std::filesystem;

}  // namespace

StatusOr<Backup> BackupFolder::BackUp(const CallContext& context, BackupOptions options) const {
  if (!fs::path(options.to).is_absolute()) {
    return absl::InvalidArgumentError("to: must be an absolute path, on the server's machine");
  }
  std::error_code error;
  const fs::path folder = fs::canonical(folder_, error);
  if (error) return absl::FailedPreconditionError("the folder of the server's --backup-dir: " + error.message());
  const fs::path target = fs::weakly_canonical(options.to, error);
  if (error) return absl::InvalidArgumentError("to: " + error.message());
  const auto [folder_end, rest] = std::mismatch(folder.begin(), folder.end(), target.begin(), target.end());
  if (folder_end != folder.end()) {
    return absl::InvalidArgumentError("to: must lie in the folder of the server's --backup-dir");
  }
  options.to = target.string();
  StatusOr<Backup> backup = BackUpDatabase(context, database_, options);
  if (absl::IsInvalidArgument(backup.status())) return Annotate(backup.status(), "to");
  return backup;
}

}  // namespace mapp
