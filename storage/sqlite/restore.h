#pragma once

#include "mapp/base/call_context.h"
#include "mapp/base/status.h"
#include "storage/sqlite/backup.h"

#include <chrono>
#include <cstdint>
#include <functional>
#include <optional>
#include <string>

namespace mapp {

/// What restoring would do.
struct RestorePlan {
  std::string backup;    ///< file to restore from
  std::string database;  ///< file to restore, symbolic links resolved
  /// Of the backup.
  int64_t num_bytes = 0;
  int schema_version = 0;
  int64_t num_maps = 0;
  int64_t num_keyframes = 0;
  /// Bytes of the database that is there now, its write-ahead log included; absent when there is none.
  std::optional<int64_t> replaced_bytes;
  /// What the replaced database is kept as, and where its write-ahead log goes when only that is left of it.
  std::string kept_as;
};

/// What is about to be done. Until kReplacing is over, the database is the old one.
enum class RestoreStep { kCopying, kChecking, kClosing, kKeeping, kReplacing };
struct RestoreProgress {
  RestoreStep step = RestoreStep::kCopying;
  BackupProgress copy;  ///< while copying and checking
};
using RestoreObserver = std::function<void(const RestoreProgress&)>;

/// Looks all of `backup` through and changes nothing. An older schema is good: the server migrates it. Errors name the
/// file that is wrong.
///   ALREADY_EXISTS       what the old one would be kept as
///   DATA_LOSS            the backup is damaged or cut short
///   FAILED_PRECONDITION  either is no map database, the backup has a newer schema, or a server owns the database
///   INVALID_ARGUMENT     both are the same file
///   NOT_FOUND            the backup, or the folder of the database
StatusOr<RestorePlan> PlanRestore(const CallContext& context, const std::string& backup, const std::string& database,
                                  std::chrono::system_clock::time_point now);

/// Puts a copy of the backup in the database's place and keeps what was there, with its write-ahead log, as
/// `plan.kept_as`. Durable when it returns; killed at any moment it leaves the old or the new one. FAILED_PRECONDITION,
/// UNAVAILABLE: a server or another program has the database open. Else as PlanRestore and BackUpDatabase.
Status Restore(const CallContext& context, const RestorePlan& plan, const RestoreObserver& on_progress);

}  // namespace mapp
