// Evidence, findings and changes of the world.

#include "mapp/base/bytes.h"
#include "storage/sqlite/rows.h"
#include "storage/sqlite/verify_check.h"
#include "storage/sqlite/verify_sql.h"

#include <fmt/format.h>

namespace mapp::sqlite {
namespace {

constexpr const char* kEvidence = R"sql(
SELECT session_id, format('evidence %d is of no session', number) FROM evidence
 WHERE session_id NOT IN (SELECT session_id FROM sessions)
UNION ALL
SELECT session_id, format('evidence has the number %d', number) FROM evidence WHERE number NOT BETWEEN 0 AND 4294967295
)sql";

constexpr const char* kFindings = R"sql(
SELECT session_id, 'findings are of no session' FROM findings WHERE session_id NOT IN (SELECT session_id FROM sessions)
)sql";

/// Columns: session, what it is, bytes, their checksum.
StatusOr<std::string> ChecksumFault(Connection& /*db*/, const Statement& row) {
  const uint32_t crc = Crc32c(row.Bytes(2));
  if (crc == row.Int64(3)) return std::string();
  return fmt::format("{}: crc32c {:#010x} != stored {:#010x}", row.Bytes(1), crc, row.Int64(3));
}

constexpr const char* kChanges = R"sql(
SELECT change_id, format('map %d does not exist', map_id) FROM changes WHERE map_id NOT IN (SELECT map_id FROM maps)
UNION ALL
SELECT c.change_id, format('detected at revision %d, applied at %s: the map is at %d', c.detected_revision,
                           coalesce(c.applied_revision, 'none'), m.revision)
  FROM changes c JOIN maps m USING (map_id)
 WHERE c.detected_revision NOT BETWEEN 0 AND m.revision OR c.applied_revision NOT BETWEEN 1 AND m.revision
UNION ALL
SELECT change_id, format('%s is no box', box)
  FROM (SELECT change_id, 'box_before' AS box, before_tx_m AS tx_m, before_ty_m AS ty_m, before_tz_m AS tz_m,
               before_qw AS qw, before_qx AS qx, before_qy AS qy, before_qz AS qz,
               before_size_x_m AS x_m, before_size_y_m AS y_m, before_size_z_m AS z_m FROM changes
        UNION ALL
        SELECT change_id, 'box_after', after_tx_m, after_ty_m, after_tz_m, after_qw, after_qx, after_qy, after_qz,
               after_size_x_m, after_size_y_m, after_size_z_m FROM changes)
 WHERE NOT (coalesce(tx_m, ty_m, tz_m, qw, qx, qy, qz, x_m, y_m, z_m) IS NULL
            OR coalesce()sql" MAPP_SQL_IS_POSE R"sql( AND x_m > 0 AND y_m > 0 AND z_m > 0, 0))
)sql";

StatusOr<std::string> ChangeFault(Connection& db, const Statement& row) {
  const StatusOr<ChangeRecord> change = ReadChange(row);
  if (!change.ok()) return std::string(change.status().message());
  std::string found;
  Statement map_of_session = db.Prepare("SELECT map_id FROM sessions WHERE session_id = ?");
  for (const SessionId session : change->sessions) {
    MAPP_ASSIGN_OR_RETURN(const bool has_row, map_of_session.Reset().Bind(session).Step());
    if (!has_row || map_of_session.GetId<MapId>(0) != change->map) {
      found += fmt::format("rests on session {}, none of its map\n", session.value());
    }
  }
  return found;
}

// Where AUTOINCREMENT keeps the greatest id that it has given.
constexpr const char* kChangeSequence = R"sql(
SELECT max(change_id), format('exists, and the greatest that was given is %s',
                              coalesce((SELECT seq FROM sqlite_sequence WHERE name = 'changes'), 'none'))
  FROM changes HAVING max(change_id) > coalesce((SELECT seq FROM sqlite_sequence WHERE name = 'changes'), 0)
)sql";

}  // namespace

std::vector<VerifyCheck> ChangeChecks() {
  return {
      {.name = "evidence", .what = "session", .sql = kEvidence},
      {.name = "evidence",
       .what = "session",
       .sql = "SELECT session_id, 'evidence ' || number, packet, crc32c FROM evidence",
       .fault = ChecksumFault},
      {.name = "findings", .what = "session", .sql = kFindings},
      {.name = "findings",
       .what = "session",
       .sql = "SELECT session_id, 'findings', blob, crc32c FROM findings",
       .fault = ChecksumFault},
      {.name = "changes", .what = "change", .sql = "SELECT " MAPP_CHANGE_COLUMNS " FROM changes", .fault = ChangeFault},
      {.name = "changes", .what = "change", .sql = kChanges},
      {.name = "change_sequence", .what = "change", .sql = kChangeSequence},
  };
}

}  // namespace mapp::sqlite
