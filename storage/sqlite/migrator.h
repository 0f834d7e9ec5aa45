#pragma once

#include "mapp/base/status.h"
#include "storage/sqlite/connection.h"

#include <cstdint>
#include <span>
#include <string>

namespace mapp::sqlite {

/// One file of migrations/.
struct Migration {
  int version;         ///< counts from 1
  const char* name;    ///< file name
  const char* sha256;  ///< of the file, hexadecimal
  const char* sql;
};

/// All of them in order, compiled in by cmake/EmbedMigrations.cmake.
std::span<const Migration> EmbeddedMigrations();

/// "Mapp" in PRAGMA application_id: tells our databases from other programs'.
inline constexpr int64_t kApplicationId = 0x4d617070;

/// The schema number of the open database, 0 for a new file. FAILED_PRECONDITION when the file belongs to another
/// program, and when it is newer than `migrations` or was made by others of the same number.
StatusOr<int> ReadSchemaVersion(Connection& db, std::span<const Migration> migrations);

struct MigrateOptions {
  /// Copy an existing database to `FILE.schema-N.backup` before the first migration; a copy already there is replaced.
  bool backup = true;
  int64_t now_ns = 0;  ///< Unix time noted with each migration
};

/// Brings the database from its version to the newest of `migrations`, each in a transaction of its own: after an
/// error it stands at the last version that succeeded, and the backup stays.
Status Migrate(Connection& db, const std::string& file, std::span<const Migration> migrations,
               const MigrateOptions& options);

}  // namespace mapp::sqlite
