#include "storage/sqlite/erasure.h"

#include "storage/checks.h"
#include "storage/sqlite/catalog.h"
#include "storage/sqlite/checksum_vfs.h"
#include "storage/sqlite/world_changes.h"

namespace mapp::sqlite {
namespace {

/// Everything of session ?1, children before parents. Live points and frames in the map are gone before it.
constexpr const char* kEraseStatements[] = {
    "DELETE FROM point_history WHERE session_id = ?1",
    "DELETE FROM session_points WHERE session_id = ?1",
    "DELETE FROM frame_observation_history WHERE frame_id IN (SELECT frame_id FROM keyframe_log WHERE session_id = ?1)",
    "DELETE FROM frame_observations WHERE frame_id IN (SELECT frame_id FROM keyframe_log WHERE session_id = ?1)",
    "DELETE FROM frame_pose_history WHERE frame_id IN (SELECT frame_id FROM keyframe_log WHERE session_id = ?1)",
    "DELETE FROM frames WHERE frame_id IN (SELECT frame_id FROM keyframe_log WHERE session_id = ?1)",
    "DELETE FROM keyframe_log WHERE session_id = ?1",
    "DELETE FROM evidence WHERE session_id = ?1",
    "DELETE FROM session_history WHERE session_id = ?1",
    "DELETE FROM map_history WHERE founder_session_id = ?1",
    "UPDATE revisions SET session_id = NULL WHERE session_id = ?1",
};

/// Derived, of map ?1: what they show of one session is not told apart.
constexpr const char* kDropDerivedStatements[] = {
    "DELETE FROM tile_blobs WHERE tile_id IN (SELECT tile_id FROM tiles WHERE map_id = ?1)",
    "DELETE FROM place_blocks WHERE map_id = ?1",
    "DELETE FROM findings WHERE session_id IN (SELECT session_id FROM sessions WHERE map_id = ?1)",
};

StatusOr<bool> Exists(Connection& db, std::string_view query, SessionId session) {
  Statement statement = db.Prepare(query);
  return statement.Bind(session).Step();
}

Status CheckErasable(Connection& db, MapId map_id, SessionId session) {
  MAPP_ASSIGN_OR_RETURN(const bool has_frames,
                        Exists(db,
                               "SELECT 1 FROM keyframe_log l JOIN frames f ON f.frame_id = l.frame_id "
                               "WHERE l.session_id = ? AND f.in_map LIMIT 1",
                               session));
  if (has_frames) return internal::StillHoldsFrames(session);
  MAPP_ASSIGN_OR_RETURN(const bool has_points,
                        Exists(db,
                               "SELECT 1 FROM session_points s JOIN points p ON p.point_id = s.point_id "
                               "WHERE s.session_id = ?1 AND p.session_id = ?1 LIMIT 1",
                               session));
  if (has_points) return internal::StillHoldsPoints(session);
  MAPP_ASSIGN_OR_RETURN(const MapRecord map, GetMap(db, map_id));
  if (map.founder == session) return internal::StillFounds(session);
  return map.oldest_revision == map.revision ? absl::OkStatus() : internal::StillHasHistory(map);
}

/// Points of others that were fused into the session's lead past them, to where those lead.
Status BypassFusions(Connection& db, SessionId session) {
  do {
    MAPP_RETURN_IF_ERROR(
        db.Prepare("UPDATE point_history AS h SET fused_into = (SELECT n.fused_into FROM point_history n WHERE "
                   "n.point_id = h.fused_into ORDER BY n.created_revision DESC LIMIT 1) WHERE h.session_id <> ?1 AND "
                   "h.fused_into IN (SELECT point_id FROM point_history WHERE session_id = ?1) AND NOT EXISTS "
                   "(SELECT 1 FROM points p WHERE p.point_id = h.fused_into)")
            .Bind(session)
            .Run());
  } while (db.num_changed() > 0);
  return absl::OkStatus();
}

}  // namespace

Status AdoptPoint(Connection& db, ChangeLedger& ledger, MapPointId point, SessionId session, uint64_t session_point,
                  const OrbDescriptor& descriptor) {
  Statement query = db.Prepare("SELECT session_id, tile_id FROM points WHERE point_id = ?");
  MAPP_ASSIGN_OR_RETURN(const bool has_row, query.Bind(point).Step());
  if (!has_row) return internal::NoSuchPoint(point);
  MAPP_ASSIGN_OR_RETURN(const MapId map, ledger.MapOfSession(query.GetId<SessionId>(0)));
  MAPP_ASSIGN_OR_RETURN(const MapId map_of_session, ledger.MapOfSession(session));
  PointRecord adopted;
  adopted.session = session;
  MAPP_RETURN_IF_ERROR(internal::CheckPointsMap(adopted, map_of_session, map));
  MAPP_RETURN_IF_ERROR(
      db.Prepare("UPDATE points SET session_id = ?, session_point = ?, descriptor = ? WHERE point_id = ?")
          .Bind(session, session_point, Blob{descriptor.Bytes()}, point)
          .Run());
  MAPP_RETURN_IF_ERROR(
      db.Prepare("INSERT OR IGNORE INTO session_points (session_id, session_point, point_id) VALUES (?, ?, ?)")
          .Bind(session, session_point, point)
          .Run());
  return query.IsNull(1) ? absl::OkStatus() : ledger.ChangeTile(map, query.Int64(1), 0);
}

Status EraseSession(Connection& db, ChangeLedger& ledger, SessionId session) {
  MAPP_ASSIGN_OR_RETURN(const MapId map, ledger.MapOfSession(session));
  MAPP_RETURN_IF_ERROR(ledger.Flush());
  MAPP_RETURN_IF_ERROR(CheckErasable(db, map, session));
  MAPP_ASSIGN_OR_RETURN(const SessionRecord record, GetSession(db, session));
  MAPP_RETURN_IF_ERROR(BypassFusions(db, session));
  MAPP_RETURN_IF_ERROR(EraseFromChanges(db, map, session));
  for (const char* sql : kEraseStatements) MAPP_RETURN_IF_ERROR(db.Prepare(sql).Bind(session).Run());
  for (const char* sql : kDropDerivedStatements) MAPP_RETURN_IF_ERROR(db.Prepare(sql).Bind(map).Run());
  MAPP_RETURN_IF_ERROR(db.Prepare("DELETE FROM sessions WHERE session_id = ?").Bind(session).Run());
  MAPP_RETURN_IF_ERROR(DeleteCameraIfUnused(db, record.camera));
  ledger.Forget(session);
  return ledger.AddSessions(map, -1);
}

Status Rewrite(Connection& db) {
  if (!HasChecksums(db)) {
    MAPP_RETURN_IF_ERROR(EnableChecksums(db));
  } else {
    MAPP_RETURN_IF_ERROR(db.Execute("VACUUM;"));
  }
  // Its first column: whether a reader of an older state kept the log from being emptied.
  MAPP_ASSIGN_OR_RETURN(const int64_t is_busy, db.QueryInt64("PRAGMA wal_checkpoint(TRUNCATE)"));
  if (is_busy == 0) return absl::OkStatus();
  return absl::UnavailableError("map database: readers hold its log; what it has kept goes when the store closes");
}

}  // namespace mapp::sqlite
