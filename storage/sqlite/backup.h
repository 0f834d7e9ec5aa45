#pragma once

#include "mapp/base/call_context.h"
#include "mapp/base/status.h"

#include <chrono>
#include <cstdint>
#include <functional>
#include <string>
#include <vector>

namespace mapp {

/// How far a copy of a database is.
struct BackupProgress {
  bool checking = false;  ///< all is copied, and the copy is looked through
  int64_t bytes_done = 0;
  int64_t bytes_total = 0;
};
using BackupObserver = std::function<void(const BackupProgress&)>;

struct BackupOptions {
  /// The file to write, or a folder that is there: the file in it is NAME-YYYYmmddTHHMMSSZ.db, where NAME.db is the
  /// database.
  std::string to = {};
  /// Of such files in the folder, how many to keep: older ones are deleted after success. 0 = all.
  int num_kept = 0;
  /// Only tell what would be written, about how large, and deleted.
  bool dry_run = false;
  BackupObserver on_progress = {};
  /// CopyOptions::pages_per_step and max_pages.
  int pages_per_step = 64;
  int64_t max_pages = 0;
  std::chrono::system_clock::time_point now = std::chrono::system_clock::now();
};

struct Backup {
  std::string file;
  int64_t num_bytes = 0;
  int schema_version = 0;
  std::vector<std::string> deleted;  ///< files that had to go, oldest first
};

/// Copies the map database `database` while others write it. The copy is one commit's state, which holds all that was
/// acknowledged before; it is one file, checked and on disk when it gets its name, and nothing is left of one that
/// fails. An existing file is never replaced. Errors name a file only where it is the backup: the caller knows
/// `database`.
///   ALREADY_EXISTS       the file to write
///   CANCELLED            as `context` says; or DEADLINE_EXCEEDED
///   DATA_LOSS            the database is damaged
///   FAILED_PRECONDITION  no map database, a newer schema, no permission; a file of that name is being written
///   INVALID_ARGUMENT     the options, or a name that another file of a database would have
///   NOT_FOUND            the database, or the folder to write into
///   RESOURCE_EXHAUSTED   no room
StatusOr<Backup> BackUpDatabase(const CallContext& context, const std::string& database, const BackupOptions& options);

/// YYYYmmddTHHMMSSZ: sorts as time does.
std::string FileTimestamp(std::chrono::system_clock::time_point time);

}  // namespace mapp
