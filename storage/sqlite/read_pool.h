#pragma once

#include "mapp/base/mutex.h"
#include "mapp/base/status.h"
#include "storage/map_store.h"
#include "storage/sqlite/connection.h"
#include "storage/sqlite/sqlite_map_store.h"

#include <memory>
#include <string>
#include <vector>

namespace mapp::sqlite {

/// Read-only connections, opened as needed, kept while idle up to a limit. Thread-safe. Readers share its ownership,
/// so that one may outlive the store.
class ReadPool : public std::enable_shared_from_this<ReadPool> {
 public:
  ReadPool(std::string file, SqliteOptions options) : file_(std::move(file)), options_(std::move(options)) {}

  /// A reader on a snapshot taken now; gives its connection back when destroyed. UNAVAILABLE once closed.
  StatusOr<std::unique_ptr<MapReader>> OpenReader();
  /// As OpenReader, of one map at an earlier revision (MapStore::ReadAsOf).
  StatusOr<std::unique_ptr<MapReader>> OpenReaderAsOf(MapId map, Revision revision);
  /// Closes the idle connections; those in use are closed when they come back.
  void Close();

 private:
  friend class SnapshotReader;

  StatusOr<std::unique_ptr<Connection>> Borrow();
  void Return(std::unique_ptr<Connection> connection);

  const std::string file_;
  const SqliteOptions options_;

  Mutex mutex_;
  bool closed_ ABSL_GUARDED_BY(mutex_) = false;
  std::vector<std::unique_ptr<Connection>> idle_ ABSL_GUARDED_BY(mutex_);
};

}  // namespace mapp::sqlite
