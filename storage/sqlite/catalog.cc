#include "storage/sqlite/catalog.h"

#include "storage/checks.h"
#include "storage/sqlite/blobs.h"
#include "storage/sqlite/rows.h"

namespace mapp::sqlite {
namespace {

/// Of an UPDATE ... RETURNING by primary key: NOT_FOUND when it met no row.
Status RunOnOneRow(Statement& statement, const Status& not_found) {
  MAPP_ASSIGN_OR_RETURN(const bool has_row, statement.Step());
  return has_row ? absl::OkStatus() : not_found;
}

Status CheckExists(Connection& db, std::string_view query, uint64_t id, const Status& not_found) {
  Statement statement = db.Prepare(query);
  return RunOnOneRow(statement.Bind(id), not_found);
}

/// Everything of map ?1, children before parents. Retired points are found through session_points, which keeps all.
constexpr const char* kDeleteMapStatements[] = {
    "DELETE FROM frame_index WHERE map_min <= ?1 AND map_max >= ?1 AND frame_id IN "
    "(SELECT frame_id FROM frames WHERE map_id = ?1)",
    "DELETE FROM tile_index WHERE map_min <= ?1 AND map_max >= ?1 AND tile_id IN "
    "(SELECT tile_id FROM tiles WHERE map_id = ?1)",
    "DELETE FROM tile_blobs WHERE tile_id IN (SELECT tile_id FROM tiles WHERE map_id = ?1)",
    "DELETE FROM tiles WHERE map_id = ?1",
    "DELETE FROM points WHERE point_id IN (SELECT point_id FROM session_points WHERE session_id IN "
    "(SELECT session_id FROM sessions WHERE map_id = ?1))",
    "DELETE FROM point_history WHERE point_id IN (SELECT point_id FROM session_points WHERE session_id IN "
    "(SELECT session_id FROM sessions WHERE map_id = ?1))",
    "DELETE FROM session_points WHERE session_id IN (SELECT session_id FROM sessions WHERE map_id = ?1)",
    "DELETE FROM frame_observation_history WHERE frame_id IN (SELECT frame_id FROM frames WHERE map_id = ?1)",
    "DELETE FROM frame_observations WHERE frame_id IN (SELECT frame_id FROM frames WHERE map_id = ?1)",
    "DELETE FROM frame_pose_history WHERE frame_id IN (SELECT frame_id FROM frames WHERE map_id = ?1)",
    "DELETE FROM frames WHERE map_id = ?1",
    "DELETE FROM keyframe_log WHERE session_id IN (SELECT session_id FROM sessions WHERE map_id = ?1)",
    "DELETE FROM changes WHERE map_id = ?1",
    "DELETE FROM findings WHERE session_id IN (SELECT session_id FROM sessions WHERE map_id = ?1)",
    "DELETE FROM evidence WHERE session_id IN (SELECT session_id FROM sessions WHERE map_id = ?1)",
    "DELETE FROM revisions WHERE map_id = ?1",
    "DELETE FROM place_blocks WHERE map_id = ?1",
    "DELETE FROM tags WHERE map_id = ?1",
    "DELETE FROM map_history WHERE map_id = ?1",
    "DELETE FROM session_history WHERE session_id IN (SELECT session_id FROM sessions WHERE map_id = ?1)",
};

/// The sessions go last but one, together with the cameras that nobody else uses.
Status DeleteSessions(Connection& db, MapId map) {
  Statement query = db.Prepare("SELECT DISTINCT camera_id FROM sessions WHERE map_id = ?");
  query.Bind(map);
  std::vector<CameraId> cameras;
  for (;;) {
    MAPP_ASSIGN_OR_RETURN(const bool has_row, query.Step());
    if (!has_row) break;
    cameras.push_back(query.GetId<CameraId>(0));
  }
  MAPP_RETURN_IF_ERROR(db.Prepare("DELETE FROM sessions WHERE map_id = ?").Bind(map).Run());
  for (const CameraId camera : cameras) MAPP_RETURN_IF_ERROR(DeleteCameraIfUnused(db, camera));
  return absl::OkStatus();
}

}  // namespace

StatusOr<std::vector<MapRecord>> ListMaps(Connection& db) {
  Statement query = db.Prepare("SELECT " MAPP_MAP_COLUMNS " FROM maps ORDER BY map_id");
  return ReadAll(query, ReadMap);
}

StatusOr<MapRecord> FindMap(Connection& db, const std::string& name) {
  Statement query = db.Prepare("SELECT " MAPP_MAP_COLUMNS " FROM maps WHERE name = ?");
  MAPP_ASSIGN_OR_RETURN(const bool has_row, query.Bind(name).Step());
  if (!has_row) return internal::NoSuchMap(name);
  return ReadMap(query);
}

StatusOr<MapRecord> GetMap(Connection& db, MapId map) {
  Statement query = db.Prepare("SELECT " MAPP_MAP_COLUMNS " FROM maps WHERE map_id = ?");
  MAPP_ASSIGN_OR_RETURN(const bool has_row, query.Bind(map).Step());
  if (!has_row) return internal::NoSuchMap(map);
  return ReadMap(query);
}

StatusOr<std::vector<SessionRecord>> ListSessions(Connection& db, std::optional<MapId> map) {
  Statement query =
      map ? db.Prepare("SELECT " MAPP_SESSION_COLUMNS " FROM sessions WHERE map_id = ? ORDER BY session_id")
          : db.Prepare("SELECT " MAPP_SESSION_COLUMNS " FROM sessions ORDER BY session_id");
  if (map) query.Bind(*map);
  return ReadAll(query, ReadSession);
}

StatusOr<SessionRecord> GetSession(Connection& db, SessionId session) {
  Statement query = db.Prepare("SELECT " MAPP_SESSION_COLUMNS " FROM sessions WHERE session_id = ?");
  MAPP_ASSIGN_OR_RETURN(const bool has_row, query.Bind(session).Step());
  if (!has_row) return internal::NoSuchSession(session);
  return ReadSession(query);
}

StatusOr<CameraRecord> GetCamera(Connection& db, CameraId camera) {
  Statement query = db.Prepare("SELECT " MAPP_CAMERA_COLUMNS " FROM cameras WHERE camera_id = ?");
  MAPP_ASSIGN_OR_RETURN(const bool has_row, query.Bind(camera).Step());
  if (!has_row) return internal::NoSuchCamera(camera);
  return ReadCamera(query);
}

StatusOr<MapId> CreateMap(Connection& db, ChangeLedger& ledger, const MapRecord& map) {
  MAPP_RETURN_IF_ERROR(internal::CheckMap(map));
  Statement taken = db.Prepare("SELECT 1 FROM maps WHERE name = ?");
  MAPP_ASSIGN_OR_RETURN(const bool exists, taken.Bind(map.name).Step());
  if (exists) return internal::MapExists(map.name);
  const FeatureSettings& features = map.features;
  MAPP_RETURN_IF_ERROR(
      db.Prepare("INSERT INTO maps (name, created_ns, revision, tile_edge_m, cone_range_m, num_frames, num_points, "
                 "num_sessions, feature_descriptor, feature_scale_factor, feature_num_levels, feature_patch_size_px) "
                 "VALUES (?, ?, 0, ?, ?, 0, 0, 0, ?, ?, ?, ?)")
          .Bind(map.name, map.created_ns != 0 ? map.created_ns : ledger.now_ns(), map.tile_edge_m, map.cone_range_m,
                features.descriptor_kind, features.scale_factor, features.num_levels, features.patch_size_px)
          .Run());
  return MapId(static_cast<uint64_t>(db.last_insert_id()));
}

Status DeleteMap(Connection& db, ChangeLedger& ledger, MapId map) {
  MAPP_RETURN_IF_ERROR(CheckExists(db, "SELECT 1 FROM maps WHERE map_id = ?", map.value(), internal::NoSuchMap(map)));
  ledger.Forget(map);
  for (const char* sql : kDeleteMapStatements) MAPP_RETURN_IF_ERROR(db.Prepare(sql).Bind(map).Run());
  MAPP_RETURN_IF_ERROR(DeleteSessions(db, map));
  return db.Prepare("DELETE FROM maps WHERE map_id = ?").Bind(map).Run();
}

Status SetFounder(Connection& db, ChangeLedger& ledger, MapId map, std::optional<SessionId> founder) {
  MAPP_RETURN_IF_ERROR(ledger.ReviseMap(map));
  Statement update = db.Prepare("UPDATE maps SET founder_session_id = ? WHERE map_id = ? RETURNING 1");
  return RunOnOneRow(update.Bind(founder, map), internal::NoSuchMap(map));
}

Status SetMetricScale(Connection& db, ChangeLedger& ledger, MapId map, bool has_metric_scale) {
  MAPP_RETURN_IF_ERROR(ledger.ReviseMap(map));
  Statement update = db.Prepare("UPDATE maps SET has_metric_scale = ? WHERE map_id = ? RETURNING 1");
  return RunOnOneRow(update.Bind(has_metric_scale, map), internal::NoSuchMap(map));
}

Status SkipIds(Connection& db, MapId map, SessionId session, FrameId frame) {
  // Where AUTOINCREMENT keeps the greatest id that a table has given.
  const auto skip = [&db](std::string_view table, uint64_t next) -> Status {
    if (next == 0) return absl::OkStatus();
    MAPP_RETURN_IF_ERROR(db.Prepare("INSERT INTO sqlite_sequence (name, seq) SELECT ?1, 0 WHERE NOT EXISTS "
                                    "(SELECT 1 FROM sqlite_sequence WHERE name = ?1)")
                             .Bind(table)
                             .Run());
    return db.Prepare("UPDATE sqlite_sequence SET seq = max(seq, ?2) WHERE name = ?1").Bind(table, next - 1).Run();
  };
  MAPP_RETURN_IF_ERROR(skip("maps", map.value()));
  MAPP_RETURN_IF_ERROR(skip("sessions", session.value()));
  return skip("keyframe_log", frame.value());
}

Status DeleteCameraIfUnused(Connection& db, CameraId camera) {
  return db
      .Prepare("DELETE FROM cameras WHERE camera_id = ?1 AND NOT EXISTS (SELECT 1 FROM sessions WHERE camera_id = ?1)")
      .Bind(camera)
      .Run();
}

StatusOr<CameraId> InsertCamera(Connection& db, const Camera& camera) {
  MAPP_RETURN_IF_ERROR(internal::CheckCamera(camera));
  const std::string model = ModelName(camera.projection);
  const std::string coefficients = EncodeDoubles(Coefficients(camera.projection));
  MAPP_RETURN_IF_ERROR(db.Prepare("INSERT INTO cameras (model, coefficients, width_px, height_px, stereo_baseline_m) "
                                  "VALUES (?, ?, ?, ?, ?)")
                           .Bind(model, Blob{coefficients}, camera.width_px, camera.height_px, camera.stereo_baseline_m)
                           .Run());
  return CameraId(static_cast<uint64_t>(db.last_insert_id()));
}

StatusOr<SessionId> InsertSession(Connection& db, ChangeLedger& ledger, const SessionRecord& session) {
  MAPP_RETURN_IF_ERROR(internal::CheckSession(session));
  MAPP_RETURN_IF_ERROR(
      CheckExists(db, "SELECT 1 FROM maps WHERE map_id = ?", session.map.value(), internal::NoSuchMap(session.map)));
  MAPP_RETURN_IF_ERROR(CheckExists(db, "SELECT 1 FROM cameras WHERE camera_id = ?", session.camera.value(),
                                   internal::NoSuchCamera(session.camera)));
  MAPP_RETURN_IF_ERROR(ledger.AddSessions(session.map, 1));
  MAPP_RETURN_IF_ERROR(db.Prepare("INSERT INTO sessions (map_id, camera_id, device, sensor, opened_ns, num_keyframes, "
                                  "num_upload_bytes) VALUES (?, ?, ?, ?, ?, 0, 0)")
                           .Bind(session.map, session.camera, session.device, static_cast<int>(session.sensor),
                                 session.opened_ns != 0 ? session.opened_ns : ledger.now_ns())
                           .Run());
  const SessionId id(static_cast<uint64_t>(db.last_insert_id()));
  MAPP_RETURN_IF_ERROR(ledger.OpenSession(session.map, id));
  SessionRecord inserted = session;
  inserted.id = id;
  MAPP_RETURN_IF_ERROR(UpdateSession(db, ledger, inserted));
  return id;
}

Status UpdateSession(Connection& db, ChangeLedger& ledger, const SessionRecord& session) {
  MAPP_RETURN_IF_ERROR(internal::CheckSession(session));
  MAPP_RETURN_IF_ERROR(ledger.ReviseSession(session.id));
  Statement update = db.Prepare(
      "UPDATE sessions SET closed_ns = ?, aligned_at_keyframe = ?, optimized_revision = ?, tx_m = ?, ty_m = ?, "
      "tz_m = ?, qw = ?, qx = ?, qy = ?, qz = ?, quarantined_ns = ?, quarantine_reason = ?, quarantine_released_ns = "
      "?, "
      "scale_map_session = ? WHERE session_id = ? RETURNING 1");
  update.Bind(session.closed_ns, session.aligned_at_keyframe, session.optimized);
  if (session.T_map_session) {
    BindPose(update, *session.T_map_session);
  } else {
    for (int i = 0; i < 7; ++i) update.Bind(std::optional<double>());
  }
  if (session.quarantine) {
    update.Bind(session.quarantine->since_ns, session.quarantine->reason, session.quarantine->released_ns);
  } else {
    for (int i = 0; i < 3; ++i) update.Bind(std::optional<int64_t>());
  }
  return RunOnOneRow(update.Bind(session.scale_map_session, session.id), internal::NoSuchSession(session.id));
}

}  // namespace mapp::sqlite
