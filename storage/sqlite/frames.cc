#include "storage/sqlite/frames.h"

#include "mapp/base/bytes.h"
#include "storage/checks.h"
#include "storage/sqlite/blobs.h"
#include "storage/sqlite/rows.h"

#include <fmt/format.h>

namespace mapp::sqlite {
namespace {

/// Enters the camera centre of a frame in the map, or takes it out.
Status Index(Connection& db, MapId map, FrameId frame, bool in_map, const Eigen::Vector3d& center) {
  if (!in_map) return db.Prepare("DELETE FROM frame_index WHERE frame_id = ?").Bind(frame).Run();
  return db.Prepare("INSERT OR REPLACE INTO frame_index VALUES (?, ?, ?, ?, ?, ?, ?, ?, ?)")
      .Bind(frame, map, map, center.x(), center.x(), center.y(), center.y(), center.z(), center.z())
      .Run();
}

Status AppendToLog(Connection& db, int64_t now_ns, const FrameRecord& frame, const std::string& packet) {
  MAPP_RETURN_IF_ERROR(
      db.Prepare("INSERT INTO keyframe_log (session_id, number, received_ns, crc32c, packet) VALUES (?, ?, ?, ?, ?)")
          .Bind(frame.session, frame.number, now_ns, Crc32c(packet), Blob{packet})
          .Run());
  return db
      .Prepare(
          "UPDATE sessions SET num_keyframes = num_keyframes + 1, num_upload_bytes = num_upload_bytes + ? "
          "WHERE session_id = ?")
      .Bind(packet.size(), frame.session)
      .Run();
}

/// Where a frame stands before it is changed.
struct Standing {
  MapId map;
  bool in_map = false;
};

StatusOr<Standing> GetStanding(Connection& db, FrameId frame) {
  Statement query = db.Prepare("SELECT map_id, in_map FROM frames WHERE frame_id = ?");
  MAPP_ASSIGN_OR_RETURN(const bool has_row, query.Bind(frame).Step());
  if (!has_row) return internal::NoSuchFrame(frame);
  return Standing{.map = query.GetId<MapId>(0), .in_map = query.Int64(1) != 0};
}

}  // namespace

StatusOr<std::optional<FrameId>> FindFrame(Connection& db, SessionId session, uint32_t number) {
  Statement query = db.Prepare("SELECT frame_id FROM keyframe_log WHERE session_id = ? AND number = ?");
  MAPP_ASSIGN_OR_RETURN(const bool has_row, query.Bind(session, number).Step());
  if (!has_row) return std::nullopt;
  return query.GetId<FrameId>(0);
}

StatusOr<FrameRecord> GetFrame(Connection& db, FrameId frame) {
  Statement query = db.Prepare("SELECT " MAPP_FRAME_COLUMNS " FROM frames WHERE frame_id = ?");
  MAPP_ASSIGN_OR_RETURN(const bool has_row, query.Bind(frame).Step());
  if (!has_row) return internal::NoSuchFrame(frame);
  return ReadFrame(query);
}

StatusOr<std::vector<FrameRecord>> ListFrames(Connection& db, MapId map, std::optional<SessionId> session) {
  // The index of the keyframe log finds a session's frames; frames needs none of its own.
  Statement query = session
                        ? db.Prepare("SELECT " MAPP_FRAME_COLUMNS
                                     " FROM frames WHERE map_id = ? AND frame_id IN (SELECT frame_id FROM keyframe_log "
                                     "WHERE session_id = ?) ORDER BY frame_id")
                        : db.Prepare("SELECT " MAPP_FRAME_COLUMNS
                                     " FROM frames WHERE map_id = ?1 AND frame_id IN (SELECT frame_id FROM "
                                     "keyframe_log WHERE session_id IN (SELECT session_id FROM sessions WHERE map_id "
                                     "= ?1)) ORDER BY frame_id");
  query.Bind(map);
  if (session) query.Bind(*session);
  return ReadAll(query, ReadFrame);
}

StatusOr<std::vector<FrameRecord>> FramesInBox(Connection& db, MapId map, const Aabb& box_map) {
  // The index rounds bounds outwards; the exact test on the pose decides.
  Statement query = db.Prepare(
      "SELECT " MAPP_FRAME_COLUMNS
      " FROM frames WHERE map_id = ?1 AND frame_id IN (SELECT frame_id FROM frame_index WHERE map_min <= ?1 AND "
      "map_max >= ?1 AND x_max_m >= ?2 AND x_min_m <= ?3 AND y_max_m >= ?4 AND y_min_m <= ?5 AND z_max_m >= ?6 AND "
      "z_min_m <= ?7) AND tx_m BETWEEN ?2 AND ?3 AND ty_m BETWEEN ?4 AND ?5 AND tz_m BETWEEN ?6 AND ?7 "
      "ORDER BY frame_id");
  query.Bind(map, box_map.min().x(), box_map.max().x(), box_map.min().y(), box_map.max().y(), box_map.min().z(),
             box_map.max().z());
  return ReadAll(query, ReadFrame);
}

StatusOr<std::string> GetPacket(Connection& db, FrameId frame) {
  Statement query = db.Prepare("SELECT packet, crc32c FROM keyframe_log WHERE frame_id = ?");
  MAPP_ASSIGN_OR_RETURN(const bool has_row, query.Bind(frame).Step());
  if (!has_row) return internal::NoSuchFrame(frame);
  std::string packet(query.Bytes(0));
  if (const uint32_t crc = Crc32c(packet); crc != query.Int64(1)) {
    return absl::DataLossError(
        fmt::format("packet of frame {}: crc32c {:#010x} != stored {:#010x}", frame.value(), crc, query.Int64(1)));
  }
  return packet;
}

StatusOr<std::vector<Observation>> GetObservations(Connection& db, FrameId frame) {
  Statement query = db.Prepare("SELECT observations FROM frame_observations WHERE frame_id = ?");
  MAPP_ASSIGN_OR_RETURN(const bool has_row, query.Bind(frame).Step());
  if (!has_row) return internal::NoSuchFrame(frame);
  StatusOr<std::vector<Observation>> observations = DecodeObservations(query.Bytes(0));
  if (!observations.ok()) return Annotate(observations.status(), fmt::format("frame {}", frame.value()));
  return observations;
}

StatusOr<FrameId> InsertFrame(Connection& db, ChangeLedger& ledger, const FrameRecord& frame, const std::string& packet,
                              std::span<const Observation> observations) {
  MAPP_RETURN_IF_ERROR(internal::CheckPose(frame.T_frame_camera));
  MAPP_ASSIGN_OR_RETURN(const MapId map, ledger.MapOfSession(frame.session));
  MAPP_RETURN_IF_ERROR(internal::CheckFrame(frame, map));
  MAPP_ASSIGN_OR_RETURN(const std::optional<FrameId> stored, FindFrame(db, frame.session, frame.number));
  if (stored) return internal::KeyframeIsStored(frame, *stored);
  MAPP_ASSIGN_OR_RETURN(const Revision revision, ledger.NextRevision(map));
  MAPP_RETURN_IF_ERROR(ledger.AttributeTo(map, frame.session));
  MAPP_RETURN_IF_ERROR(AppendToLog(db, ledger.now_ns(), frame, packet));
  const FrameId id(static_cast<uint64_t>(db.last_insert_id()));

  Statement insert = db.Prepare(
      "INSERT INTO frames (frame_id, map_id, session_id, camera_id, number, stamp_ns, partial, overlap, num_features, "
      "num_packet_bytes, created_revision, pose_revision, in_map, tx_m, ty_m, tz_m, qw, qx, qy, qz) "
      "VALUES (?, ?, ?, ?, ?, ?, ?, ?, ?, ?, ?, ?, ?, ?, ?, ?, ?, ?, ?, ?)");
  insert.Bind(id, map, frame.session, frame.camera, frame.number, frame.stamp_ns, frame.partial, frame.overlap,
              frame.num_features, packet.size(), revision, revision, frame.in_map);
  BindPose(insert, frame.T_frame_camera);
  MAPP_RETURN_IF_ERROR(insert.Run());

  const std::string encoded = EncodeObservations(observations);
  MAPP_RETURN_IF_ERROR(
      db.Prepare("INSERT INTO frame_observations (frame_id, created_revision, observations) VALUES (?, ?, ?)")
          .Bind(id, revision, Blob{encoded})
          .Run());
  if (frame.in_map) {
    MAPP_RETURN_IF_ERROR(Index(db, map, id, true, frame.T_frame_camera.translation()));
    MAPP_RETURN_IF_ERROR(ledger.AddFrames(map, 1));
  }
  return id;
}

Status SetFramePose(Connection& db, ChangeLedger& ledger, FrameId frame, bool in_map, const Pose3& T_frame_camera) {
  MAPP_RETURN_IF_ERROR(internal::CheckPose(T_frame_camera));
  MAPP_ASSIGN_OR_RETURN(const Standing old, GetStanding(db, frame));
  MAPP_ASSIGN_OR_RETURN(const Revision revision, ledger.NextRevision(old.map));
  // A version that begins and ends in one revision could never be read: it leaves no history.
  MAPP_RETURN_IF_ERROR(
      db.Prepare("INSERT INTO frame_pose_history (frame_id, created_revision, retired_revision, in_map, tx_m, ty_m, "
                 "tz_m, qw, qx, qy, qz) SELECT frame_id, pose_revision, ?1, in_map, tx_m, ty_m, tz_m, qw, qx, qy, qz "
                 "FROM frames WHERE frame_id = ?2 AND pose_revision <> ?1")
          .Bind(revision, frame)
          .Run());
  Statement update = db.Prepare(
      "UPDATE frames SET pose_revision = ?, in_map = ?, tx_m = ?, ty_m = ?, tz_m = ?, qw = ?, qx = ?, qy = ?, qz = ? "
      "WHERE frame_id = ?");
  update.Bind(revision, in_map);
  BindPose(update, T_frame_camera);
  MAPP_RETURN_IF_ERROR(update.Bind(frame).Run());
  if (in_map || old.in_map) {
    MAPP_RETURN_IF_ERROR(Index(db, old.map, frame, in_map, T_frame_camera.translation()));
  }
  return ledger.AddFrames(old.map, static_cast<int>(in_map) - static_cast<int>(old.in_map));
}

Status SetObservations(Connection& db, ChangeLedger& ledger, FrameId frame, std::span<const Observation> observations) {
  MAPP_ASSIGN_OR_RETURN(const Standing state, GetStanding(db, frame));
  MAPP_ASSIGN_OR_RETURN(const Revision revision, ledger.NextRevision(state.map));
  MAPP_RETURN_IF_ERROR(
      db.Prepare("INSERT INTO frame_observation_history (frame_id, created_revision, retired_revision, observations) "
                 "SELECT frame_id, created_revision, ?1, observations FROM frame_observations "
                 "WHERE frame_id = ?2 AND created_revision <> ?1")
          .Bind(revision, frame)
          .Run());
  const std::string encoded = EncodeObservations(observations);
  return db.Prepare("UPDATE frame_observations SET created_revision = ?, observations = ? WHERE frame_id = ?")
      .Bind(revision, Blob{encoded}, frame)
      .Run();
}

}  // namespace mapp::sqlite
