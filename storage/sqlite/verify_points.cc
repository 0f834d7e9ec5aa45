// Points, what they name and what names them.

#include "storage/sqlite/blobs.h"
#include "storage/sqlite/rows.h"
#include "storage/sqlite/verify_check.h"

#include <fmt/format.h>

#include <cmath>

namespace mapp::sqlite {
namespace {

/// Directions are float32 and turn with every correction.
constexpr double kDirectionTolerance = 1e-3;

// Columns of points, then of their session and its map, and the version's end (NULL: it lives).
constexpr const char* kLivePoints = "SELECT " MAPP_POINT_COLUMNS
                                    ", m.revision, NULL FROM points p LEFT JOIN sessions s ON s.session_id = "
                                    "p.session_id LEFT JOIN maps m ON m.map_id = s.map_id";
constexpr const char* kOldPoints = "SELECT " MAPP_POINT_COLUMNS
                                   ", m.revision, p.retired_revision FROM point_history p LEFT JOIN sessions s ON "
                                   "s.session_id = p.session_id LEFT JOIN maps m ON m.map_id = s.map_id";
constexpr int kMapRevisionColumn = 14;
constexpr int kRetiredColumn = 15;

StatusOr<std::string> PointFault(Connection& /*db*/, const Statement& row) {
  const StatusOr<PointRecord> point = ReadPoint(row);
  if (!point.ok()) return std::string(point.status().message());
  std::string found;
  if (!(std::abs(point->view_direction.norm() - 1) <= kDirectionTolerance)) {
    found += fmt::format("view direction has length {}\n", point->view_direction.norm());
  }
  if (!(point->confidence >= 0 && point->confidence <= 1)) {
    found += fmt::format("confidence {} is not in [0, 1]\n", point->confidence);
  }
  if (!std::isfinite(point->reference_distance_m)) found += "reference distance is not finite\n";
  if (point->observers.size() > TilePoint::kMaxObservers) {
    found += fmt::format("names {} observers\n", point->observers.size());
  }
  if (row.IsNull(kMapRevisionColumn)) {
    return found += fmt::format("session {} does not exist\n", point->session.value());
  }
  const int64_t created = row.Int64(4);
  const int64_t map_revision = row.Int64(kMapRevisionColumn);
  // A point that is made and retired at once leaves a version that was never read.
  const int64_t end = row.IsNull(kRetiredColumn) ? created : row.Int64(kRetiredColumn);
  if (created < 1 || end < created || end > map_revision) {
    found += fmt::format("version of revisions {} to {}: the map is at {}\n", created, end, map_revision);
  }
  return found;
}

constexpr const char* kHistory = R"sql(
SELECT h.point_id, format('versions of revisions %d and %d overlap', h.created_revision, n.created_revision)
  FROM point_history h JOIN point_history n ON n.point_id = h.point_id AND n.created_revision > h.created_revision
                                           AND n.created_revision < h.retired_revision
UNION ALL
SELECT h.point_id, format('version of revisions %d to %d overlaps the live one of %d', h.created_revision,
                          h.retired_revision, p.created_revision)
  FROM point_history h CROSS JOIN points p ON p.point_id = h.point_id WHERE h.retired_revision > p.created_revision
)sql";

// Versions of the past, too: they are copies of what was live.
constexpr const char* kTiles = R"sql(
SELECT p.point_id, p.x_m, p.y_m, p.z_m, p.tile_id, t.tile_key, t.map_id, s.map_id, m.tile_edge_m
  FROM (SELECT point_id, session_id, tile_id, x_m, y_m, z_m FROM points WHERE tile_id IS NOT NULL
        UNION ALL
        SELECT point_id, session_id, tile_id, x_m, y_m, z_m FROM point_history WHERE tile_id IS NOT NULL) p
       LEFT JOIN tiles t ON t.tile_id = p.tile_id LEFT JOIN sessions s ON s.session_id = p.session_id
       LEFT JOIN maps m ON m.map_id = s.map_id
)sql";

StatusOr<std::string> PointTileFault(Connection& /*db*/, const Statement& row) {
  if (row.IsNull(5)) return fmt::format("tile {} does not exist", row.Int64(4));
  if (row.IsNull(8) || row.Int64(6) != row.Int64(7)) {
    return fmt::format("tile {} is of map {}, the point of another", row.Int64(4), row.Int64(6));
  }
  const Eigen::Vector3d p_map(row.Double(1), row.Double(2), row.Double(3));
  const TileKey key = TileKey::FromPacked(static_cast<uint64_t>(row.Int64(5)));
  const double edge_m = row.Double(8);
  // A NaN has no tile; that is a finding of its own.
  if (!p_map.allFinite() || !(edge_m > 0) || TileGrid{edge_m}.KeyOf(p_map) == key) return std::string();
  return fmt::format("({}, {}, {}) m is not in its tile {}", p_map.x(), p_map.y(), p_map.z(), key.ToString());
}

constexpr const char* kSessionPoints = R"sql(
SELECT i.point_id, format('number %d of session %d stands for it, and no such point was ever made', i.session_point,
                          i.session_id)
  FROM session_points i
 WHERE NOT EXISTS (SELECT 1 FROM points p WHERE p.point_id = i.point_id AND p.session_id = i.session_id
                                            AND p.session_point = i.session_point)
   AND NOT EXISTS (SELECT 1 FROM point_history p WHERE p.point_id = i.point_id AND p.session_id = i.session_id
                                                   AND p.session_point = i.session_point)
   -- A point that ended before the oldest revision may have been dropped; its number stays.
   AND NOT EXISTS (SELECT 1 FROM sessions s JOIN maps m USING (map_id)
                    WHERE s.session_id = i.session_id AND m.oldest_revision > 0)
UNION ALL
SELECT point_id, format('no number of session %d stands for it', session_id) FROM points p
 WHERE NOT EXISTS (SELECT 1 FROM session_points i WHERE i.session_id = p.session_id
                                                    AND i.session_point = p.session_point AND i.point_id = p.point_id)
UNION ALL
SELECT point_id, format('no number of session %d stands for it', session_id) FROM point_history p
 WHERE NOT EXISTS (SELECT 1 FROM session_points i WHERE i.session_id = p.session_id
                                                    AND i.session_point = p.session_point AND i.point_id = p.point_id)
)sql";

/// The point that stood for `point` when it was retired; 0 for one that lives or ended otherwise.
StatusOr<int64_t> FusedInto(Connection& db, int64_t point) {
  Statement query = db.Prepare(
      "SELECT fused_into FROM point_history WHERE point_id = ?1 AND NOT EXISTS (SELECT 1 FROM points WHERE point_id = "
      "?1) ORDER BY created_revision DESC LIMIT 1");
  MAPP_ASSIGN_OR_RETURN(const bool has_row, query.Bind(point).Step());
  return has_row && !query.IsNull(0) ? query.Int64(0) : 0;
}

/// Columns: point, its map, what it was fused into, that one's map.
StatusOr<std::string> FusionFault(Connection& db, const Statement& row) {
  // The one it was fused into may have ended since, and been dropped from the history.
  if (row.IsNull(3) && row.Int64(4) != 0) return std::string();
  if (row.IsNull(3)) return fmt::format("is fused into point {}, which does not exist", row.Int64(2));
  if (row.Int64(3) != row.Int64(1)) return fmt::format("is fused into point {} of another map", row.Int64(2));
  // Two walks, one twice as fast: they meet only on a circle (Floyd).
  int64_t slow = row.Int64(0);
  int64_t fast = slow;
  for (;;) {
    for (int step = 0; step < 2; ++step) {
      MAPP_ASSIGN_OR_RETURN(fast, FusedInto(db, fast));
      if (fast == 0) return std::string();
    }
    MAPP_ASSIGN_OR_RETURN(slow, FusedInto(db, slow));
    if (slow == fast) return fmt::format("is fused into point {}, and so on in a circle", row.Int64(2));
  }
}

constexpr const char* kFusions = R"sql(
SELECT h.point_id, s.map_id, h.fused_into,
       (SELECT t.map_id FROM (SELECT session_id FROM points WHERE point_id = h.fused_into
                              UNION ALL SELECT session_id FROM point_history WHERE point_id = h.fused_into LIMIT 1)
               JOIN sessions t USING (session_id)),
       m.oldest_revision > 0
  FROM point_history h LEFT JOIN sessions s ON s.session_id = h.session_id LEFT JOIN maps m USING (map_id)
 WHERE h.fused_into IS NOT NULL
)sql";

constexpr const char* kObservers = R"sql(
SELECT p.point_id, p.observers, s.map_id FROM points p JOIN sessions s USING (session_id)
UNION ALL
SELECT p.point_id, p.observers, s.map_id FROM point_history p JOIN sessions s USING (session_id)
)sql";

StatusOr<std::string> ObserverFault(Connection& db, const Statement& row) {
  std::vector<FrameId> observers;
  if (!DecodeObservers(row.Bytes(1), &observers)) return std::string();  // a finding of its own
  std::string found;
  Statement map_of_frame = db.Prepare("SELECT map_id FROM frames WHERE frame_id = ?");
  for (const FrameId frame : observers) {
    MAPP_ASSIGN_OR_RETURN(const bool has_row, map_of_frame.Reset().Bind(frame).Step());
    if (!has_row || map_of_frame.Int64(0) != row.Int64(2)) {
      found += fmt::format("names observer {}, no frame of its map\n", frame.value());
    }
  }
  return found;
}

}  // namespace

std::vector<VerifyCheck> PointChecks() {
  return {
      {.name = "points", .what = "point", .sql = kLivePoints, .fault = PointFault},
      {.name = "point_history", .what = "point", .sql = kOldPoints, .fault = PointFault},
      {.name = "point_history", .what = "point", .sql = kHistory},
      {.name = "point_tiles", .what = "point", .sql = kTiles, .fault = PointTileFault},
      {.name = "session_points", .what = "point", .sql = kSessionPoints},
      {.name = "fusions", .what = "point", .sql = kFusions, .fault = FusionFault},
      {.name = "observers", .what = "point", .sql = kObservers, .fault = ObserverFault},
  };
}

}  // namespace mapp::sqlite
