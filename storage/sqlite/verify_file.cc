#include "storage/sqlite/verify_check.h"

namespace mapp::sqlite {
namespace {

/// Column 1 is what SQLite's own checks say: "ok", or lines of findings.
StatusOr<std::string> SqliteFindings(Connection& /*db*/, const Statement& row) {
  constexpr std::string_view kHeading = "*** in database main ***";
  std::string found(row.Bytes(1));
  if (found == "ok") return std::string();
  if (found.starts_with(kHeading)) found.erase(0, kHeading.size());
  return found;
}

}  // namespace

std::vector<VerifyCheck> FileChecks() {
  return {
      {.name = "integrity",
       .what = "file",
       .sql = "SELECT NULL, integrity_check FROM pragma_integrity_check(1000)",
       .fault = SqliteFindings},
      {.name = "rtree",
       .what = "frame_index",
       .sql = "SELECT NULL, rtreecheck('main', 'frame_index')",
       .fault = SqliteFindings},
      {.name = "rtree",
       .what = "tile_index",
       .sql = "SELECT NULL, rtreecheck('main', 'tile_index')",
       .fault = SqliteFindings},
      {.name = "foreign_keys",
       .what = "row",
       .sql = R"sql(SELECT rowid, format('of %s refers to a row of %s that does not exist', "table", parent)
                      FROM pragma_foreign_key_check)sql"},
  };
}

}  // namespace mapp::sqlite
