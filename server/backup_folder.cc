#include "server/backup_folder.h"

#include <algorithm>
#include <filesystem>
#include <system_error>

namespace mapp {
namespace {

namespace fs = std::filesystem;

/// More backups than anybody keeps, and a number that fits.
constexpr uint32_t kMaxNumKept = 1'000'000;

}  // namespace

StatusOr<Backup> BackupFolder::BackUp(const CallContext& context, const std::string& to, uint32_t num_kept,
                                      const BackupObserver& on_progress) const {
  if (!fs::path(to).is_absolute()) {
    return absl::InvalidArgumentError("to: must be an absolute path, on the server's machine");
  }
  std::error_code error;
  const fs::path folder = fs::canonical(folder_, error);
  if (error) return absl::FailedPreconditionError("the folder of the server's --backup-dir: " + error.message());
  const fs::path target = fs::weakly_canonical(to, error);
  if (error) return absl::InvalidArgumentError("to: " + error.message());
  const auto [folder_end, rest] = std::mismatch(folder.begin(), folder.end(), target.begin(), target.end());
  if (folder_end != folder.end()) {
    return absl::InvalidArgumentError("to: must lie in the folder of the server's --backup-dir");
  }
  BackupOptions options;
  options.to = target.string();
  options.num_kept = static_cast<int>(std::min(num_kept, kMaxNumKept));
  options.on_progress = on_progress;
  StatusOr<Backup> backup = BackUpDatabase(context, database_, options);
  if (absl::IsInvalidArgument(backup.status())) return Annotate(backup.status(), "to");
  return backup;
}

}  // namespace mapp
