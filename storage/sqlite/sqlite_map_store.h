#pragma once

#include "mapp/base/status.h"
#include "storage/map_store.h"

#include <chrono>
#include <cstdint>
#include <functional>
#include <memory>
#include <string>

namespace mapp {

/// How a map database is opened.
struct SqliteOptions {
  /// Bytes a page, a power of two in [512, 65536]; takes effect when the file is created. Larger pages make a packet
  /// (about 40 KB) and a tile cheaper and small updates dearer. 16 KB writes packets 30-40 % faster than SQLite's 4 KB.
  int page_size_bytes = 16384;
  /// A checksum at the end of every page, so that damage is found before it is served; takes effect when the file is
  /// created. docs/formats/database.md.
  bool page_checksums = true;
  /// How long to wait for a lock that another process holds (a backup, a tool) before UNAVAILABLE.
  std::chrono::milliseconds busy_timeout{5000};
  /// synchronous = FULL: what Write has acknowledged survives a power cut. Without it only a crash of the process, in
  /// exchange for one disk sync less a commit.
  bool sync_commits = true;
  /// Copy an older database to FILE.schema-N.backup before it is migrated.
  bool backup_before_migration = true;
  /// For tools: no lock, no migration, Write refused. Works beside a server that owns the file.
  bool read_only = false;
  /// Page cache of the writing connection and of each reading one, KiB. Bounds the store's memory together with the
  /// number of simultaneous readers.
  int writer_cache_kb = 32 * 1024;
  int reader_cache_kb = 8 * 1024;
  /// Reading connections kept open while idle; more are opened when needed and closed again.
  int max_idle_readers = 8;
  /// Greatest size of the file in pages; 0 = as large as the disk lets it. A write beyond it finds a full disk.
  int64_t max_pages = 0;
  /// Unix time in nanoseconds for what the store dates itself.
  std::function<int64_t()> unix_now_ns = [] {
    return std::chrono::duration_cast<std::chrono::nanoseconds>(std::chrono::system_clock::now().time_since_epoch())
        .count();
  };
};

/// Opens the map database in `file`, creates it when absent, and migrates an older one (not when read-only).
/// FAILED_PRECONDITION: not a map database, a newer schema, owned by another server, no permission. NOT_FOUND: the
/// folder, or with read_only the file, does not exist. DATA_LOSS: corrupt. Messages are one line and name the file.
StatusOr<std::unique_ptr<MapStore>> OpenSqliteMapStore(const std::string& file, const SqliteOptions& options = {});

}  // namespace mapp
