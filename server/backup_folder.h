#pragma once

#include "mapp/base/call_context.h"
#include "mapp/base/status.h"
#include "storage/sqlite/backup.h"

#include <cstdint>
#include <string>

namespace mapp {

/// Where callers may have the server write backups, and nowhere else. Thread-safe.
class BackupFolder {
 public:
  /// `folder` is there.
  BackupFolder(std::string database, std::string folder) : database_(std::move(database)), folder_(std::move(folder)) {}

  /// BackUpDatabase of the server's database. INVALID_ARGUMENT: `to` is not absolute, or lies outside of the folder,
  /// symbolic links followed.
  StatusOr<Backup> BackUp(const CallContext& context, BackupOptions options) const;

 private:
  const std::string database_;
  const std::string folder_;
};

}  // namespace mapp
