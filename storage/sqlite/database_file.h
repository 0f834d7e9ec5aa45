#pragma once

#include "mapp/base/status.h"
#include "storage/sqlite/connection.h"
#include "storage/sqlite/sqlite_map_store.h"

#include <memory>
#include <string>

namespace mapp::sqlite {

/// `file` with symbolic links resolved, so that one database has one lock whatever it is called. NOT_FOUND when its
/// folder does not exist; FAILED_PRECONDITION for a folder or device in its place, or a file that is no SQLite
/// database: before anything, such as a lock, is put beside it.
StatusOr<std::string> ResolveFile(const std::string& file, bool must_exist);

/// The connection that writes: creates the file if absent, migrates it, sets write-ahead logging and durability.
StatusOr<std::unique_ptr<Connection>> OpenForWriting(const std::string& file, const SqliteOptions& options);

/// A connection that only reads. The schema is not checked.
StatusOr<std::unique_ptr<Connection>> OpenForReading(const std::string& file, const SqliteOptions& options);

/// FAILED_PRECONDITION unless the database has exactly this program's schema.
Status CheckSchemaIsCurrent(Connection& db);

}  // namespace mapp::sqlite
