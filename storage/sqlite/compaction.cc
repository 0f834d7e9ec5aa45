#include "storage/sqlite/compaction.h"

#include "storage/sqlite/revisions.h"

#include <fmt/format.h>

#include <algorithm>

namespace mapp::sqlite {
namespace {

/// A history table and which of its rows belong to map ?1.
struct HistoryTable {
  const char* name;
  const char* key;
  const char* of_map;
  int64_t rows_a_unit;  ///< so many count as one: those of another table are as much larger
};

// A point's last version says what it was fused into: a device may name the point for as long as its session lives.
constexpr HistoryTable kTables[] = {
    {"point_history", "point_id, created_revision",
     "fused_into IS NULL AND session_id IN (SELECT session_id FROM main.sessions WHERE map_id = ?1)", 1},
    {"frame_pose_history", "frame_id, created_revision",
     "frame_id IN (SELECT frame_id FROM main.frames WHERE map_id = ?1)", 1},
    {"frame_observation_history", "frame_id, created_revision",
     "frame_id IN (SELECT frame_id FROM main.frames WHERE map_id = ?1)", 50},
    {"session_history", "session_id, created_revision",
     "session_id IN (SELECT session_id FROM main.sessions WHERE map_id = ?1)", 1},
    {"map_history", "map_id, created_revision", "map_id = ?1", 1},
};

}  // namespace

StatusOr<int64_t> CountHistory(Connection& db, MapId map, Revision oldest) {
  MAPP_RETURN_IF_ERROR(CheckRevision(db, map, oldest));
  int64_t num_rows = 0;
  for (const HistoryTable& table : kTables) {
    Statement count = db.Prepare(
        fmt::format("SELECT count(*) FROM main.{} WHERE retired_revision <= ?2 AND {}", table.name, table.of_map));
    MAPP_RETURN_IF_ERROR(count.Bind(map, oldest).Step().status());
    num_rows += count.Int64(0);
  }
  return num_rows;
}

StatusOr<int64_t> DropHistory(Connection& db, ChangeLedger& ledger, MapId map, Revision oldest, int64_t max_rows) {
  MAPP_RETURN_IF_ERROR(ledger.Flush());
  MAPP_RETURN_IF_ERROR(CheckRevision(db, map, oldest));
  MAPP_RETURN_IF_ERROR(db.Prepare("UPDATE maps SET oldest_revision = ? WHERE map_id = ?").Bind(oldest, map).Run());
  for (const HistoryTable& table : kTables) {
    MAPP_RETURN_IF_ERROR(
        db.Prepare(
              fmt::format("DELETE FROM {0} WHERE ({1}) IN (SELECT {1} FROM {0} WHERE retired_revision <= ?2 AND {2} "
                          "LIMIT ?3)",
                          table.name, table.key, table.of_map))
            .Bind(map, oldest, std::max<int64_t>(1, max_rows / table.rows_a_unit))
            .Run());
    if (const int64_t num_dropped = db.num_changed(); num_dropped > 0) return num_dropped;
  }
  return 0;
}

StatusOr<int64_t> GiveBackSpace(Connection& db, int64_t max_bytes) {
  MAPP_ASSIGN_OR_RETURN(const int64_t page_bytes, db.QueryInt64("PRAGMA page_size"));
  MAPP_RETURN_IF_ERROR(
      db.Execute(fmt::format("PRAGMA incremental_vacuum({});", std::max<int64_t>(1, max_bytes / page_bytes))));
  MAPP_ASSIGN_OR_RETURN(const int64_t num_free, db.QueryInt64("PRAGMA freelist_count"));
  return num_free * page_bytes;
}

}  // namespace mapp::sqlite
