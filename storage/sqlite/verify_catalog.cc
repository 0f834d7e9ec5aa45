// Maps, cameras, sessions and revisions.

#include "storage/sqlite/rows.h"
#include "storage/sqlite/verify_check.h"
#include "storage/sqlite/verify_sql.h"

#include <absl/strings/str_cat.h>

namespace mapp::sqlite {
namespace {

/// Of a row's status.
template <typename Record>
Fault Reads(StatusOr<Record> (*read)(const Statement&)) {
  return [read](Connection& /*db*/, const Statement& row) -> StatusOr<std::string> {
    return std::string(read(row).status().message());
  };
}

// An empty map has no founder.
constexpr const char* kMaps =
    "SELECT map_id, format('cone range %g m and tile edge %g m cannot be', cone_range_m, tile_edge_m) FROM maps "
    "WHERE NOT (cone_range_m >= 0 AND cone_range_m <= " MAPP_SQL_MAX " AND tile_edge_m <= " MAPP_SQL_MAX
    ")"
    R"sql(
UNION ALL
SELECT map_id, format('revision %d, the state''s %d and the oldest one %d cannot be together', revision, state_revision,
                      oldest_revision) FROM maps
 WHERE revision < 0 OR state_revision NOT BETWEEN 0 AND revision OR oldest_revision NOT BETWEEN 0 AND revision
UNION ALL
SELECT map_id, format('founder session %d is none of its sessions', founder_session_id) FROM maps m
 WHERE founder_session_id IS NOT NULL
   AND NOT EXISTS (SELECT 1 FROM sessions s WHERE s.session_id = m.founder_session_id AND s.map_id = m.map_id)
)sql";

constexpr const char* kMapCounters = R"sql(
SELECT m.map_id, format('num_frames is %d, and %d frames are in the map', m.num_frames, coalesce(c.n, 0))
  FROM maps m LEFT JOIN (SELECT map_id, count(*) AS n FROM frames WHERE in_map GROUP BY map_id) c USING (map_id)
 WHERE m.num_frames <> coalesce(c.n, 0)
UNION ALL
SELECT m.map_id, format('num_points is %d, and its tiles have %d', m.num_points, coalesce(c.n, 0))
  FROM maps m LEFT JOIN (SELECT map_id, sum(num_points) AS n FROM tiles GROUP BY map_id) c USING (map_id)
 WHERE m.num_points <> coalesce(c.n, 0)
UNION ALL
SELECT m.map_id, format('num_sessions is %d, and it has %d', m.num_sessions, coalesce(c.n, 0))
  FROM maps m LEFT JOIN (SELECT map_id, count(*) AS n FROM sessions GROUP BY map_id) c USING (map_id)
 WHERE m.num_sessions <> coalesce(c.n, 0)
)sql";

constexpr const char* kMapHistory = R"sql(
SELECT h.map_id, format('version of revisions %d to %d is of no map or beyond its revision', h.created_revision,
                        h.retired_revision)
  FROM map_history h LEFT JOIN maps m USING (map_id)
 WHERE m.map_id IS NULL OR h.created_revision >= h.retired_revision OR h.retired_revision > m.state_revision
UNION ALL
SELECT h.map_id, format('versions of revisions %d and %d overlap', h.created_revision, n.created_revision)
  FROM map_history h JOIN map_history n ON n.map_id = h.map_id AND n.created_revision > h.created_revision
                                       AND n.created_revision < h.retired_revision
)sql";

constexpr const char* kCameras = R"sql(
SELECT camera_id, format('image of %d x %d pixels, stereo baseline %g m', width_px, height_px, stereo_baseline_m)
  FROM cameras WHERE width_px <= 0 OR height_px <= 0 OR length(coefficients) % 8 <> 0
    OR NOT abs(stereo_baseline_m) <= )sql" MAPP_SQL_MAX;

// Either all of T_map_session is there or nothing.
constexpr const char* kSessions = R"sql(
SELECT session_id, 'T_map_session is no pose' FROM sessions
 WHERE NOT ((tx_m IS NULL AND ty_m IS NULL AND tz_m IS NULL AND qw IS NULL AND qx IS NULL AND qy IS NULL AND qz IS NULL)
            OR coalesce()sql" MAPP_SQL_IS_POSE R"sql(, 0)) OR NOT scale_map_session <= )sql" MAPP_SQL_MAX R"sql(
UNION ALL
SELECT s.session_id, format('opened at revision %d, state of %d, optimized at %s: the map is at %d', opened_revision,
                            s.state_revision, coalesce(optimized_revision, 'none'), m.revision)
  FROM sessions s JOIN maps m USING (map_id)
 WHERE opened_revision NOT BETWEEN 0 AND s.state_revision OR s.state_revision > m.revision
    OR optimized_revision NOT BETWEEN 0 AND m.revision
)sql";

constexpr const char* kSessionCounters = R"sql(
SELECT s.session_id, format('num_keyframes is %d and num_upload_bytes %d, and its log has %d of %d bytes',
                            s.num_keyframes, s.num_upload_bytes, coalesce(c.n, 0), coalesce(c.bytes, 0))
  FROM sessions s
       LEFT JOIN (SELECT session_id, count(*) AS n, sum(length(packet)) AS bytes
                    FROM keyframe_log GROUP BY session_id) c USING (session_id)
 WHERE s.num_keyframes <> coalesce(c.n, 0) OR s.num_upload_bytes <> coalesce(c.bytes, 0)
)sql";

constexpr const char* kSessionHistory = R"sql(
SELECT h.session_id, format('version of revisions %d to %d is of no session or beyond its state', h.created_revision,
                            h.retired_revision)
  FROM session_history h LEFT JOIN sessions s USING (session_id)
 WHERE s.session_id IS NULL OR h.created_revision >= h.retired_revision OR h.created_revision < s.opened_revision
    OR h.retired_revision > s.state_revision
UNION ALL
SELECT h.session_id, format('versions of revisions %d and %d overlap', h.created_revision, n.created_revision)
  FROM session_history h JOIN session_history n ON n.session_id = h.session_id
                         AND n.created_revision > h.created_revision AND n.created_revision < h.retired_revision
UNION ALL
SELECT session_id, format('T_map_session of revision %d is no pose', created_revision) FROM session_history
 WHERE NOT ((tx_m IS NULL AND ty_m IS NULL AND tz_m IS NULL AND qw IS NULL AND qx IS NULL AND qy IS NULL AND qz IS NULL)
            OR coalesce()sql" MAPP_SQL_IS_POSE R"sql(, 0))
    OR NOT (scale_map_session > 0 AND scale_map_session <= )sql" MAPP_SQL_MAX ")";

constexpr const char* kRevisions = R"sql(
SELECT r.map_id, format('revision %d: the map is at %d', r.revision, m.revision)
  FROM revisions r JOIN maps m USING (map_id) WHERE r.revision NOT BETWEEN 1 AND m.revision
UNION ALL
SELECT r.map_id, format('revision %d has the unknown cause %d', r.revision, r.cause) FROM revisions r
 WHERE r.cause NOT BETWEEN 0 AND 13
UNION ALL
SELECT r.map_id, format('revision %d is of session %d, none of the map''s', r.revision, r.session_id)
  FROM revisions r LEFT JOIN sessions s USING (session_id)
 WHERE r.session_id IS NOT NULL AND s.map_id IS NOT r.map_id
UNION ALL
SELECT m.map_id, format('%d of the %d revisions since the oldest one have a row', coalesce(c.n, 0),
                        m.revision - m.oldest_revision)
  FROM maps m LEFT JOIN (SELECT r.map_id, count(*) AS n FROM revisions r JOIN maps USING (map_id)
                          WHERE r.revision > oldest_revision GROUP BY r.map_id) c USING (map_id)
 WHERE coalesce(c.n, 0) <> m.revision - m.oldest_revision
)sql";

constexpr const char* kTags = R"sql(
SELECT t.map_id, format('tag "%w" names revision %d, which is not there', t.name, t.revision)
  FROM tags t LEFT JOIN maps m USING (map_id) WHERE m.map_id IS NULL OR t.revision NOT BETWEEN 0 AND m.revision
)sql";

constexpr const char* kIdSequence = R"sql(
WITH used AS (SELECT max(coalesce((SELECT max(point_id) FROM points), 0),
                         coalesce((SELECT max(point_id) FROM point_history), 0)) AS id)
SELECT id, format('exists, and the next one to be made is %d', next_id)
  FROM used LEFT JOIN id_sequences ON name = 'point' WHERE next_id IS NULL OR next_id <= id
)sql";

/// Column 1 is the block's number, 2 its bytes.
Fault PlaceBlockFault(const std::function<Status(std::string_view)>& check) {
  return [check](Connection& /*db*/, const Statement& row) -> StatusOr<std::string> {
    const Status status = check(row.Bytes(2));
    if (status.ok()) return std::string();
    return absl::StrCat("place block ", row.Int64(1), ": ", status.message());
  };
}

}  // namespace

std::vector<VerifyCheck> CatalogChecks(const VerifyOptions& options) {
  std::vector<VerifyCheck> checks = {
      {.name = "maps", .what = "map", .sql = "SELECT " MAPP_MAP_COLUMNS " FROM maps", .fault = Reads(ReadMap)},
      {.name = "maps", .what = "map", .sql = kMaps},
      {.name = "map_counters", .what = "map", .sql = kMapCounters},
      {.name = "map_history", .what = "map", .sql = kMapHistory},
      {.name = "cameras",
       .what = "camera",
       .sql = "SELECT " MAPP_CAMERA_COLUMNS " FROM cameras",
       .fault = Reads(ReadCamera)},
      {.name = "cameras", .what = "camera", .sql = kCameras},
      {.name = "sessions",
       .what = "session",
       .sql = "SELECT " MAPP_SESSION_COLUMNS " FROM sessions",
       .fault = Reads(ReadSession)},
      {.name = "sessions", .what = "session", .sql = kSessions},
      {.name = "session_counters", .what = "session", .sql = kSessionCounters},
      {.name = "session_history", .what = "session", .sql = kSessionHistory},
      {.name = "revisions", .what = "map", .sql = kRevisions},
      {.name = "tags", .what = "map", .sql = kTags},
      {.name = "id_sequence", .what = "point", .sql = kIdSequence},
      {.name = "place_blocks",
       .what = "map",
       .sql = "SELECT map_id, format('place block %d is of no map', block) FROM place_blocks WHERE map_id NOT IN "
              "(SELECT map_id FROM maps)"},
  };
  if (options.check_place_block) {
    checks.push_back({.name = "place_blocks",
                      .what = "map",
                      .sql = "SELECT map_id, block, blob FROM place_blocks",
                      .fault = PlaceBlockFault(options.check_place_block)});
  }
  return checks;
}

}  // namespace mapp::sqlite
