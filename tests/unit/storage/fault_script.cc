#include "tests/unit/storage/fault_script.h"

#include "mapp/codec/tile_codec.h"
#include "tests/unit/storage/numbered_keyframes.h"
#include "tests/unit/storage/store_fixture.h"

#include <algorithm>

namespace mapp {
namespace {

constexpr size_t kPlaceBlockBytes = 15'000;
constexpr size_t kEvidenceBytes = 3'000;

StatusOr<SessionId> AddSession(MapWriter& writer, MapId map) {
  SessionRecord session;
  session.map = map;
  MAPP_ASSIGN_OR_RETURN(session.camera, writer.InsertCamera(TestCamera()));
  session.device = "robot-7";
  return writer.InsertSession(session);
}

StatusOr<MapRecord> FindOrAddMap(MapWriter& writer, const std::string& name) {
  StatusOr<MapRecord> found = writer.FindMap(name);
  if (found.ok() || !absl::IsNotFound(found.status())) return found;
  MapRecord map;
  map.name = name;
  MAPP_ASSIGN_OR_RETURN(map.id, writer.CreateMap(map));
  MAPP_ASSIGN_OR_RETURN(const SessionId founder, AddSession(writer, map.id));
  MAPP_RETURN_IF_ERROR(writer.SetFounder(map.id, founder));
  return writer.GetMap(map.id);
}

Status MoveAndFusePoints(MapWriter& writer, const MapRecord& map, SessionId session) {
  MAPP_RETURN_IF_ERROR(writer.SetCause(map.id, RevisionCause::kFusion, session));
  MAPP_ASSIGN_OR_RETURN(std::vector<PointRecord> points, writer.PointsOfSession(session));
  std::ranges::sort(points, {}, &PointRecord::id);
  for (size_t i = 0; i + 1 < points.size(); i += 4) {
    MAPP_RETURN_IF_ERROR(writer.RetirePoint(points[i].id, points[i + 1].id));
    points[i + 1].position.y() += 0.01;
    points[i + 1].in_map = true;
    MAPP_RETURN_IF_ERROR(writer.UpdatePoint(points[i + 1]));
  }
  return absl::OkStatus();
}

Status MoveFrames(MapWriter& writer, const MapRecord& map, SessionId session, int step) {
  MAPP_RETURN_IF_ERROR(writer.SetCause(map.id, RevisionCause::kOptimization, session));
  MAPP_ASSIGN_OR_RETURN(const std::vector<FrameRecord> frames, writer.ListFrames(map.id, session));
  for (const FrameRecord& frame : frames) {
    MAPP_ASSIGN_OR_RETURN(std::vector<Observation> observations, writer.GetObservations(frame.id));
    if (!observations.empty()) observations.pop_back();
    MAPP_RETURN_IF_ERROR(writer.SetObservations(frame.id, observations));
    MAPP_RETURN_IF_ERROR(writer.SetFramePose(frame.id, true, PoseAt(0.2 * frame.number, 0.01 * step, 0)));
  }
  return absl::OkStatus();
}

Status CloseSessionAndOpenAnother(MapWriter& writer, const MapRecord& map, SessionId session, int step) {
  MAPP_ASSIGN_OR_RETURN(SessionRecord record, writer.GetSession(session));
  record.closed_ns = step;
  record.T_map_session = PoseAt(0, 0, 0);
  record.aligned_at_keyframe = 0;
  MAPP_RETURN_IF_ERROR(writer.UpdateSession(record));
  return AddSession(writer, map.id).status();
}

/// Also a second map, to be deleted again.
Status CacheTilesAndPlaces(MapWriter& writer, const MapRecord& map, int step) {
  MAPP_ASSIGN_OR_RETURN(const std::vector<TileRecord> tiles, writer.ListTiles(map.id, std::nullopt));
  for (const TileRecord& record : tiles) {
    Tile tile;
    tile.key = record.key;
    tile.edge_m = map.tile_edge_m;
    MAPP_RETURN_IF_ERROR(writer.PutTileBlob(map.id, record.key, {.revision = Revision(0), .bytes = EncodeTile(tile)}));
  }
  MAPP_RETURN_IF_ERROR(writer.AppendPlaceBlock(map.id, TestBytes(step, kPlaceBlockBytes)));
  MAPP_ASSIGN_OR_RETURN(const MapRecord second, FindOrAddMap(writer, "scratch"));
  return writer.AppendPlaceBlock(second.id, TestBytes(step + 1, kPlaceBlockBytes));
}

/// A change of the world with what it rests on; its points go and come back.
Status ReportChange(MapWriter& writer, const MapRecord& map, SessionId session, int step) {
  const auto number = static_cast<uint32_t>(step);
  MAPP_ASSIGN_OR_RETURN(const bool is_stored, writer.HasEvidence(session, number));
  if (!is_stored) {
    MAPP_RETURN_IF_ERROR(writer.AppendEvidence(
        {.session = session, .number = number, .received_ns = 0, .packet = TestBytes(number, kEvidenceBytes)}));
  }
  MAPP_RETURN_IF_ERROR(writer.PutFindings(session, TestBytes(number + 1, kEvidenceBytes)));
  MAPP_ASSIGN_OR_RETURN(std::vector<PointRecord> points, writer.PointsOfSession(session));
  std::ranges::sort(points, {}, &PointRecord::id);
  ChangeRecord change;
  change.map = map.id;
  change.sessions = {session};
  change.box_before = OrientedBox{.T_frame_box = PoseAt(step, 0, 0), .size_m = {1, 1, 1}};
  for (const PointRecord& point : points) {
    change.points_before.push_back(point.id);
    MAPP_RETURN_IF_ERROR(writer.RetirePoint(point.id, std::nullopt));
    MAPP_RETURN_IF_ERROR(writer.ReturnPoint(point));
  }
  return writer.PutChange(change).status();
}

Status Compact(MapWriter& writer, const MapRecord& map) {
  MAPP_RETURN_IF_ERROR(writer.PutTag(map.id, "kept", map.revision));
  return writer.DropHistory(map.id, Revision(map.revision.value() - map.revision.value() / 4), 1000).status();
}

Status DeleteSecondMap(MapWriter& writer) {
  MAPP_ASSIGN_OR_RETURN(const MapRecord second, FindOrAddMap(writer, "scratch"));
  MAPP_RETURN_IF_ERROR(writer.DeleteMap(second.id));
  return writer.GiveBackSpace(1 << 20).status();
}

}  // namespace

Status RunScriptStep(MapWriter& writer, int step) {
  MAPP_ASSIGN_OR_RETURN(const MapRecord map, FindOrAddMap(writer, "kitchen"));
  MAPP_ASSIGN_OR_RETURN(const std::vector<SessionRecord> sessions, writer.ListSessions(map.id));
  const SessionId session = sessions.back().id;
  switch (step % 12) {
    case 4:
      return MoveAndFusePoints(writer, map, session);
    case 5:
      return MoveFrames(writer, map, session, step);
    case 6:
      return CacheTilesAndPlaces(writer, map, step);
    case 8:
      return ReportChange(writer, map, session, step);
    case 9:
      return CloseSessionAndOpenAnother(writer, map, session, step);
    case 10:
      return Compact(writer, map);
    case 11:
      return DeleteSecondMap(writer);
    default:
      return AddNumberedKeyframe(writer, sessions.back(), static_cast<uint32_t>(step));
  }
}

}  // namespace mapp
