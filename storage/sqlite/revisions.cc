#include "storage/sqlite/revisions.h"

#include "storage/checks.h"
#include "storage/sqlite/catalog.h"

#include <fmt/format.h>

#include <algorithm>
#include <map>
#include <string_view>

namespace mapp::sqlite {
namespace {

/// A frame's pose at revisions ?2 and ?3, where it may differ. `was` and `is` say whether it stood in the map.
constexpr std::string_view kFrameDiff = R"sql(
WITH
  changed AS (
    SELECT frame_id FROM main.frames WHERE map_id = ?1 AND pose_revision > ?2),
  old AS (
    SELECT h.frame_id, h.in_map, h.tx_m, h.ty_m, h.tz_m, h.qw, h.qx, h.qy, h.qz
      FROM changed CROSS JOIN main.frame_pose_history h USING (frame_id)
     WHERE h.created_revision <= ?2 AND ?2 < h.retired_revision),
  new AS (
    SELECT f.frame_id, f.in_map, f.tx_m, f.ty_m, f.tz_m, f.qw, f.qx, f.qy, f.qz
      FROM changed CROSS JOIN main.frames f USING (frame_id) WHERE f.pose_revision <= ?3
    UNION ALL
    SELECT h.frame_id, h.in_map, h.tx_m, h.ty_m, h.tz_m, h.qw, h.qx, h.qy, h.qz
      FROM changed CROSS JOIN main.frame_pose_history h USING (frame_id)
     WHERE h.created_revision <= ?3 AND ?3 < h.retired_revision)
SELECT f.session_id, coalesce(old.in_map, 0) AS was, coalesce(new.in_map, 0) AS [is],
       (old.tx_m, old.ty_m, old.tz_m, old.qw, old.qx, old.qy, old.qz) IS NOT
       (new.tx_m, new.ty_m, new.tz_m, new.qw, new.qx, new.qy, new.qz) AS moved, count(*)
  FROM changed JOIN main.frames f USING (frame_id) LEFT JOIN old USING (frame_id) LEFT JOIN new USING (frame_id)
 GROUP BY 1, 2, 3, 4)sql";

/// The same of points; ?1 is the map.
constexpr std::string_view kPointDiff = R"sql(
WITH
  of_map AS (SELECT session_id FROM main.sessions WHERE map_id = ?1),
  changed AS (
    SELECT point_id, session_id FROM main.points WHERE created_revision > ?2 AND session_id IN of_map
    UNION
    SELECT point_id, session_id FROM main.point_history WHERE retired_revision > ?2 AND session_id IN of_map),
  old AS (
    SELECT h.point_id, h.tile_id, h.x_m, h.y_m, h.z_m
      FROM changed CROSS JOIN main.point_history h USING (point_id)
     WHERE h.created_revision <= ?2 AND ?2 < h.retired_revision),
  new AS (
    SELECT p.point_id, p.tile_id, p.x_m, p.y_m, p.z_m
      FROM changed CROSS JOIN main.points p USING (point_id) WHERE p.created_revision <= ?3
    UNION ALL
    SELECT h.point_id, h.tile_id, h.x_m, h.y_m, h.z_m
      FROM changed CROSS JOIN main.point_history h USING (point_id)
     WHERE h.created_revision <= ?3 AND ?3 < h.retired_revision)
SELECT session_id, old.tile_id IS NOT NULL AS was, new.tile_id IS NOT NULL AS [is],
       (old.x_m, old.y_m, old.z_m) IS NOT (new.x_m, new.y_m, new.z_m) AS moved, count(*)
  FROM changed LEFT JOIN old USING (point_id) LEFT JOIN new USING (point_id)
 GROUP BY 1, 2, 3, 4)sql";

/// The counters that a difference goes to.
struct Counters {
  int64_t SessionDiff::*added;
  int64_t SessionDiff::*moved;
  int64_t SessionDiff::*removed;
};

Status AddDiff(Statement query, const Counters& counters, std::map<SessionId, SessionDiff>& diffs) {
  for (;;) {
    MAPP_ASSIGN_OR_RETURN(const bool has_row, query.Step());
    if (!has_row) return absl::OkStatus();
    const bool was = query.Int64(1) != 0;
    const bool is = query.Int64(2) != 0;
    const bool moved = query.Int64(3) != 0;
    if (!was && !is) continue;
    if (was && is && !moved) continue;
    const auto session = query.GetId<SessionId>(0);
    SessionDiff& diff = diffs[session];
    diff.session = session;
    diff.*(!was ? counters.added : !is ? counters.removed : counters.moved) += query.Int64(4);
  }
}

}  // namespace

Status CheckRevision(Connection& db, MapId map, Revision revision) {
  MAPP_ASSIGN_OR_RETURN(const MapRecord record, GetMap(db, map));
  return internal::CheckRevision(record, revision);
}

StatusOr<std::vector<RevisionRecord>> ListRevisions(Connection& db, MapId map, Revision first, Revision last) {
  MAPP_RETURN_IF_ERROR(GetMap(db, map).status());
  Statement query = db.Prepare(
      "SELECT revision, committed_ns, cause, session_id FROM revisions WHERE map_id = ? AND revision BETWEEN ? AND ? "
      "ORDER BY revision");
  // Ids are unsigned; what no revision reaches anyway must not turn negative.
  const auto bound = [](Revision revision) { return std::min<uint64_t>(revision.value(), INT64_MAX); };
  query.Bind(map, bound(first), bound(last));
  std::vector<RevisionRecord> revisions;
  for (;;) {
    MAPP_ASSIGN_OR_RETURN(const bool has_row, query.Step());
    if (!has_row) return revisions;
    RevisionRecord& record = revisions.emplace_back();
    record.revision = query.GetId<Revision>(0);
    record.committed_ns = query.Int64(1);
    const int64_t cause = query.Int64(2);
    if (cause < 0 || cause > static_cast<int64_t>(RevisionCause::kImport)) {
      return absl::DataLossError(fmt::format("revision {}: unknown cause {}", record.revision.value(), cause));
    }
    record.cause = static_cast<RevisionCause>(cause);
    if (!query.IsNull(3)) record.session = query.GetId<SessionId>(3);
  }
}

StatusOr<std::vector<TagRecord>> ListTags(Connection& db, MapId map) {
  MAPP_RETURN_IF_ERROR(GetMap(db, map).status());
  Statement query = db.Prepare("SELECT name, revision, created_ns FROM tags WHERE map_id = ? ORDER BY name");
  query.Bind(map);
  std::vector<TagRecord> tags;
  for (;;) {
    MAPP_ASSIGN_OR_RETURN(const bool has_row, query.Step());
    if (!has_row) return tags;
    tags.push_back({std::string(query.Bytes(0)), query.GetId<Revision>(1), query.Int64(2)});
  }
}

StatusOr<std::vector<SessionDiff>> DiffRevisions(Connection& db, MapId map, Revision from, Revision to) {
  MAPP_RETURN_IF_ERROR(internal::CheckRevisionOrder(from, to));
  MAPP_RETURN_IF_ERROR(CheckRevision(db, map, from));
  MAPP_RETURN_IF_ERROR(CheckRevision(db, map, to));
  std::map<SessionId, SessionDiff> diffs;
  Statement frames = db.Prepare(kFrameDiff);
  frames.Bind(map, from, to);
  MAPP_RETURN_IF_ERROR(AddDiff(std::move(frames),
                               {&SessionDiff::frames_added, &SessionDiff::frames_moved, &SessionDiff::frames_removed},
                               diffs));
  Statement points = db.Prepare(kPointDiff);
  points.Bind(map, from, to);
  MAPP_RETURN_IF_ERROR(AddDiff(std::move(points),
                               {&SessionDiff::points_added, &SessionDiff::points_moved, &SessionDiff::points_removed},
                               diffs));
  std::vector<SessionDiff> result;
  for (const auto& [session, diff] : diffs) result.push_back(diff);
  return result;
}

Status PutTag(Connection& db, ChangeLedger& ledger, MapId map, const std::string& name, Revision revision) {
  MAPP_RETURN_IF_ERROR(internal::CheckTagName(name));
  MAPP_RETURN_IF_ERROR(ledger.Flush());
  MAPP_RETURN_IF_ERROR(CheckRevision(db, map, revision));
  return db
      .Prepare(
          "INSERT INTO tags (map_id, name, revision, created_ns) VALUES (?, ?, ?, ?) ON CONFLICT (map_id, name) DO "
          "UPDATE SET revision = excluded.revision, created_ns = excluded.created_ns")
      .Bind(map, name, revision, ledger.now_ns())
      .Run();
}

Status DeleteTag(Connection& db, MapId map, const std::string& name) {
  MAPP_ASSIGN_OR_RETURN(const MapRecord record, GetMap(db, map));
  MAPP_RETURN_IF_ERROR(db.Prepare("DELETE FROM tags WHERE map_id = ? AND name = ?").Bind(map, name).Run());
  if (db.num_changed() > 0) return absl::OkStatus();
  return internal::NoSuchTag(record, name);
}

}  // namespace mapp::sqlite
