#include "tests/unit/storage/random_script.h"

#include "tests/unit/storage/map_dump.h"

#include <fmt/format.h>

#include <limits>

namespace mapp {

double RandomScript::RandomOrBad(double otherwise) {
  if (!OneIn(30)) return otherwise;
  return OneIn(2) ? std::numeric_limits<double>::quiet_NaN() : 1e12;
}

void RandomScript::Note(const std::string& operation, const Status& status) {
  lines_.push_back(fmt::format("{}: {}", operation, status.ToString()));
}

template <typename IdType>
void RandomScript::Note(const std::string& operation, const StatusOr<IdType>& id, std::vector<IdType>* known) {
  if (id.ok()) known->push_back(*id);
  lines_.push_back(fmt::format("{}: {}", operation, id.ok() ? std::to_string(id->value()) : id.status().ToString()));
}

std::vector<std::string> RandomScript::Change(MapStore& store) {
  const Known before = known_;
  lines_.clear();
  const uint64_t num_operations = 1 + rng_.Below(8);
  const bool looks_inside = OneIn(8);
  const uint64_t end = rng_.Below(12);
  const Status status = store.Write({}, [&](MapWriter& writer) -> Status {
    for (uint64_t i = 0; i < num_operations; ++i) Operate(writer);
    if (looks_inside) lines_.push_back(DumpAll(writer));
    if (end == 0) return absl::AbortedError("changed my mind");
    if (end == 1) throw std::runtime_error("broken caller");
    return absl::OkStatus();
  });
  if (!status.ok()) known_ = before;
  Note("change", status);
  return lines_;
}

void RandomScript::Operate(MapWriter& writer) {
  switch (rng_.Below(28)) {
    case 0:
      return CreateMap(writer);
    case 1:
      return OneIn(8) ? DeleteMap(writer) : CreateMap(writer);
    case 2:
      return ChangeMap(writer);
    case 3:
      return NameRevision(writer);
    case 4:
      return InsertSession(writer);
    case 5:
      return UpdateSession(writer);
    case 6:
    case 7:
    case 8:
      return InsertFrame(writer);
    case 9:
    case 10:
      return ChangeFrame(writer);
    case 11:
    case 12:
      return RetirePoint(writer);
    case 13:
      return PutBlob(writer);
    case 24:
    case 25:
      return ReturnPoint(writer);
    case 26:
      return ReportChange(writer);
    case 27:
      return ChangeChange(writer);
    case 14:
    case 15:
    case 16:
    case 17:
      return ChangePoint(writer);
    default:
      return InsertPoint(writer);
  }
}

void RandomScript::CreateMap(MapWriter& writer) {
  MapRecord map;
  map.name = fmt::format("map {}", rng_.Below(3));
  map.tile_edge_m = OneIn(10) ? -1 : 8;
  map.cone_range_m = OneIn(10) ? 0 : 12;
  map.features.num_levels = OneIn(10) ? 0 : 7;
  Note("create map", writer.CreateMap(map), &known_.maps);
}

void RandomScript::DeleteMap(MapWriter& writer) {
  const MapId map = Pick(known_.maps);
  Note(fmt::format("delete map {}", map.value()), writer.DeleteMap(map));
}

void RandomScript::ChangeMap(MapWriter& writer) {
  const MapId map = Pick(known_.maps);
  switch (rng_.Below(4)) {
    case 0:
      return Note("set founder", writer.SetFounder(map, Pick(known_.sessions)));
    case 1:
      return Note("set metric scale", writer.SetMetricScale(map, OneIn(2)));
    case 2:
      return Note("append place block", writer.AppendPlaceBlock(map, fmt::format("block {}", rng_.Below(100))));
    default:
      const StatusOr<Revision> revision = writer.NextRevision(map);
      Note(fmt::format("next revision {}", revision.ok() ? revision->value() : 0), revision.status());
  }
}

void RandomScript::NameRevision(MapWriter& writer) {
  const MapId map = Pick(known_.maps);
  const std::string tag = OneIn(10) ? "7" : fmt::format("tag {}", rng_.Below(4));
  switch (rng_.Below(3)) {
    case 0:
      return Note("set cause", writer.SetCause(map, static_cast<RevisionCause>(rng_.Below(8)),
                                               OneIn(2) ? std::optional(Pick(known_.sessions)) : std::nullopt));
    case 1:
      return Note("put tag", writer.PutTag(map, tag, Revision(rng_.Below(20))));
    default:
      return Note("delete tag", writer.DeleteTag(map, tag));
  }
}

SessionRecord RandomScript::RandomSession() {
  SessionRecord session;
  session.map = Pick(known_.maps);
  session.camera = Pick(known_.cameras);
  session.device = fmt::format("device {}", rng_.Below(100));
  session.sensor = static_cast<SensorKind>(1 + rng_.Below(4));
  session.scale_map_session = OneIn(10) ? RandomOrBad(-1) : rng_.Uniform(0.5, 2);
  if (OneIn(2)) session.closed_ns = static_cast<int64_t>(rng_.Below(1000));
  if (OneIn(2)) session.T_map_session = RandomPose();
  if (OneIn(2)) session.aligned_at_keyframe = static_cast<uint32_t>(rng_.Below(10));
  if (OneIn(2)) session.optimized = Revision(rng_.Below(10));
  if (OneIn(2)) session.quarantine = Quarantine{.since_ns = 5, .reason = "looks wrong", .released_ns = std::nullopt};
  if (session.quarantine && OneIn(2)) session.quarantine->released_ns = 7;
  return session;
}

void RandomScript::InsertSession(MapWriter& writer) {
  if (known_.cameras.empty() || OneIn(3)) {
    Camera camera = TestCamera();
    camera.stereo_baseline_m = RandomOrBad(0.1);
    Note("insert camera", writer.InsertCamera(camera), &known_.cameras);
  }
  Note("insert session", writer.InsertSession(RandomSession()), &known_.sessions);
}

void RandomScript::UpdateSession(MapWriter& writer) {
  SessionRecord session = RandomSession();
  session.id = Pick(known_.sessions);
  Note(fmt::format("update session {}", session.id.value()), writer.UpdateSession(session));
}

MapId RandomScript::MapFor(MapWriter& writer, SessionId session) {
  const StatusOr<SessionRecord> record = writer.GetSession(session);
  return record.ok() && !OneIn(30) ? record->map : Pick(known_.maps);
}

std::vector<Observation> RandomScript::RandomObservations() {
  std::vector<Observation> observations(rng_.Below(4));
  for (Observation& observation : observations) {
    observation = {.feature_idx = static_cast<uint16_t>(rng_.Below(65536)),
                   .point = Pick(known_.points),
                   .depth_m = static_cast<float>(rng_.Below(10))};
  }
  return observations;
}

void RandomScript::InsertFrame(MapWriter& writer) {
  const SessionId session = Pick(known_.sessions);
  FrameRecord frame = TestFrame(MapFor(writer, session), session, Pick(known_.cameras),
                                static_cast<uint32_t>(rng_.Below(40)), RandomPose());
  frame.in_map = OneIn(2);
  frame.partial = OneIn(2);
  if (OneIn(2)) frame.overlap = static_cast<float>(RandomOrBad(0.5));
  Note(fmt::format("insert frame {} of session {}", frame.number, session.value()),
       writer.InsertFrame(frame, TestBytes(rng_.Next(), 20), RandomObservations()), &known_.frames);
}

void RandomScript::ChangeFrame(MapWriter& writer) {
  const FrameId frame = Pick(known_.frames);
  if (OneIn(3)) {
    return Note(fmt::format("set observations of {}", frame.value()),
                writer.SetObservations(frame, RandomObservations()));
  }
  Note(fmt::format("set pose of {}", frame.value()), writer.SetFramePose(frame, OneIn(2), RandomPose()));
}

void RandomScript::InsertPoint(MapWriter& writer) {
  const SessionId session = Pick(known_.sessions);
  const PointRecord point = TestPoint(session, rng_.Below(50), RandomPosition(), OneIn(2));
  Note(fmt::format("insert point of session {}", session.value()), writer.InsertPoint(MapFor(writer, session), point),
       &known_.points);
}

void RandomScript::ChangePoint(MapWriter& writer) {
  const MapPointId id = Pick(known_.points);
  const std::vector<PointRecord> found = Value(writer.FindPoints(std::span(&id, 1)));
  PointRecord point = found.empty() ? TestPoint(Pick(known_.sessions), 1, {1, 1, 1}) : found[0];
  point.id = id;
  point.view_direction = Eigen::Vector3f(static_cast<float>(rng_.Uniform()), 1, 0);
  point.descriptor = TestPoint({}, rng_.Next(), {}).descriptor;
  point.num_observations = static_cast<uint32_t>(rng_.Below(1000));
  point.confidence = static_cast<float>(RandomOrBad(rng_.Uniform()));
  point.reference_distance_m = static_cast<float>(rng_.Uniform(1, 9));
  point.observers.assign(rng_.Below(4), Pick(known_.frames));
  if (OneIn(2)) return Note(fmt::format("touch point {}", id.value()), writer.TouchPoint(point));
  point.position = RandomPosition();
  point.in_map = OneIn(2);
  Note(fmt::format("update point {}", id.value()), writer.UpdatePoint(point));
}

void RandomScript::RetirePoint(MapWriter& writer) {
  const MapPointId point = Pick(known_.points);
  for (const PointRecord& record : Value(writer.FindPoints(std::span(&point, 1)))) known_.retired.push_back(record);
  const std::optional<MapPointId> into = OneIn(3) ? std::nullopt : std::optional(Pick(known_.points));
  Note(fmt::format("retire point {} into {}", point.value(), into ? into->value() : 0),
       writer.RetirePoint(point, into));
}

void RandomScript::ReturnPoint(MapWriter& writer) {
  if (known_.retired.empty()) return RetirePoint(writer);
  PointRecord point = known_.retired[rng_.Below(known_.retired.size())];
  if (OneIn(4)) point.position = RandomPosition();
  if (OneIn(4)) point.in_map = !point.in_map;
  if (OneIn(10)) point.id = Pick(known_.points);
  if (OneIn(10)) point.session = Pick(known_.sessions);
  Note(fmt::format("return point {}", point.id.value()), writer.ReturnPoint(point));
}

void RandomScript::ReportChange(MapWriter& writer) {
  const SessionId session = Pick(known_.sessions);
  switch (rng_.Below(4)) {
    case 0:
      return Note("put findings", writer.PutFindings(session, TestBytes(rng_.Next(), 30)));
    case 1:
      return Note("drop findings", writer.DropFindings(Pick(known_.maps)));
    default:
      Note("append evidence", writer.AppendEvidence({.session = session,
                                                     .number = static_cast<uint32_t>(rng_.Below(10)),
                                                     .received_ns = OneIn(2) ? 0 : 7,
                                                     .packet = TestBytes(rng_.Next(), rng_.Below(40))}));
  }
}

void RandomScript::ChangeChange(MapWriter& writer) {
  if (OneIn(5)) return Note("delete change", writer.DeleteChange(Pick(known_.changes)));
  ChangeRecord change;
  if (OneIn(3)) change.id = Pick(known_.changes);
  change.sessions = {Pick(known_.sessions)};
  change.map = MapFor(writer, change.sessions[0]);
  change.kind = static_cast<ChangeKind>(1 + rng_.Below(3));
  change.status = static_cast<ChangeStatus>(OneIn(20) ? 0 : 1 + rng_.Below(3));
  change.confidence = RandomOrBad(rng_.Uniform());
  if (!OneIn(3)) change.box_before = OrientedBox{.T_frame_box = RandomPose(), .size_m = {1, 2, RandomOrBad(3)}};
  if (!OneIn(3)) change.box_after = OrientedBox{.T_frame_box = RandomPose(), .size_m = {1, 2, 3}};
  for (uint64_t id = rng_.Below(3); id < 1000; id += 1 + rng_.Below(400)) change.points_before.emplace_back(id);
  if (OneIn(2)) change.applied = Revision(rng_.Below(9));
  Note(fmt::format("put change {}", change.id.value()), writer.PutChange(change), &known_.changes);
}

void RandomScript::PutBlob(MapWriter& writer) {
  const TileKey tile{static_cast<int32_t>(rng_.Below(6)) - 3, 0, 0};
  const TileBlob blob{.revision = Revision(rng_.Below(50)), .bytes = TestBytes(rng_.Next(), 30)};
  Note("put blob of " + tile.ToString(), writer.PutTileBlob(Pick(known_.maps), tile, blob));
}

}  // namespace mapp
