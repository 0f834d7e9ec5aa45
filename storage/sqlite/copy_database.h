#pragma once

#include "mapp/base/call_context.h"
#include "mapp/base/status.h"
#include "storage/sqlite/backup.h"
#include "storage/sqlite/connection.h"
#include "storage/sqlite/staged_file.h"

#include <cstdint>

namespace mapp::sqlite {

struct CopyOptions {
  /// Between two steps, the context is asked and `on_progress` told. 64 pages are 1 MB.
  int pages_per_step = 64;
  /// Refuse a copy that is damaged or no map database.
  bool check = true;
  /// Greatest size of the copy in pages; 0 = as large as the disk lets it. A copy beyond it finds a full disk.
  int64_t max_pages = 0;
  BackupObserver on_progress = {};
};

/// Copies the last commit of `source` into `copy`, one file without a journal, while others read and write the source;
/// returns its bytes. `copy` is for the caller to commit. The write-ahead log of the source grows meanwhile by what is
/// written. CANCELLED, DEADLINE_EXCEEDED: `context` says so. RESOURCE_EXHAUSTED: no room. DATA_LOSS: damaged.
StatusOr<int64_t> CopyDatabase(const CallContext& context, Connection& source, StagedFile& copy,
                               const CopyOptions& options);

/// How closely SQLite looks at a database: kQuick does not compare indices with their tables.
enum class Thoroughness { kQuick, kFull };
/// DATA_LOSS with SQLite's first finding when pages, rows or indices of the database are damaged. UNAVAILABLE when it
/// cannot be read.
Status CheckSound(const CallContext& context, Connection& db, Thoroughness thoroughness);

}  // namespace mapp::sqlite
