#include "tests/unit/storage/map_dump.h"

#include "mapp/base/bytes.h"
#include "tests/unit/storage/store_fixture.h"

#include <fmt/format.h>

#include <algorithm>
#include <numeric>

namespace mapp {
namespace {

std::string Describe(const Pose3& pose) {
  const Eigen::Vector3d& t = pose.translation();
  const Eigen::Quaterniond& q = pose.rotation();
  return fmt::format("({} {} {} | {} {} {} {})", t.x(), t.y(), t.z(), q.w(), q.x(), q.y(), q.z());
}

template <typename T>
std::string Describe(const std::optional<T>& value) {
  if (!value) return "-";
  if constexpr (std::is_arithmetic_v<T>) {
    return fmt::format("{}", *value);
  } else {
    return fmt::format("{}", value->value());
  }
}

std::string Describe(const MapRecord& map) {
  return fmt::format(
      "map {} {} created {} revision {} edge {} range {} founder {} metric {} frames {} points {} "
      "sessions {} features {}\n",
      map.id.value(), map.name, map.created_ns, map.revision.value(), map.tile_edge_m, map.cone_range_m,
      Describe(map.founder), map.has_metric_scale, map.num_frames, map.num_points, map.num_sessions,
      map.features.num_levels);
}

std::string Describe(const SessionRecord& session) {
  return fmt::format(
      "session {} map {} {} camera {} sensor {} opened {} closed {} T {} scale {} aligned {} optimized "
      "{} keyframes {} bytes {} quarantine {}\n",
      session.id.value(), session.map.value(), session.device, session.camera.value(), static_cast<int>(session.sensor),
      session.opened_ns, Describe(session.closed_ns), session.T_map_session ? Describe(*session.T_map_session) : "-",
      session.scale_map_session, Describe(session.aligned_at_keyframe), Describe(session.optimized),
      session.num_keyframes, session.num_upload_bytes, session.quarantine ? session.quarantine->reason : "-");
}

std::string Describe(const FrameRecord& frame) {
  return fmt::format("frame {} session {} number {} in_map {} {} created {}", frame.id.value(), frame.session.value(),
                     frame.number, frame.in_map, Describe(frame.T_frame_camera), frame.created.value());
}

std::string Describe(const PointRecord& point) {
  return fmt::format("point {} session {} number {} in_map {} ({} {} {}) created {}\n", point.id.value(),
                     point.session.value(), point.session_point, point.in_map, point.position.x(), point.position.y(),
                     point.position.z(), point.created.value());
}

std::string Describe(const std::optional<OrientedBox>& box) {
  if (!box) return "-";
  return fmt::format("{} {} x {} x {}", Describe(box->T_frame_box), box->size_m.x(), box->size_m.y(), box->size_m.z());
}

template <typename IdType>
std::string Describe(const std::vector<IdType>& ids) {
  std::string text;
  for (const IdType id : ids) text += fmt::format("{},", id.value());
  return text;
}

std::string Describe(const ChangeRecord& change) {
  return fmt::format(
      "change {} kind {} status {} confidence {} times {} {} {} {} sessions {} before {} {} after {} {} "
      "detected {} applied {}\n",
      change.id.value(), static_cast<int>(change.kind), static_cast<int>(change.status), change.confidence,
      change.after_ns, change.before_ns, change.first_seen_ns, change.last_seen_ns, Describe(change.sessions),
      Describe(change.box_before), Describe(change.points_before), Describe(change.box_after),
      Describe(change.points_after), change.detected.value(), Describe(change.applied));
}

std::string DumpEvidence(MapReader& reader, SessionId session) {
  std::string dump;
  for (const EvidenceRecord& evidence : Value(reader.ListEvidence(session))) {
    dump += fmt::format("session {} evidence {} received {} crc {}\n", evidence.session.value(), evidence.number,
                        evidence.received_ns, Crc32c(evidence.packet));
  }
  const std::optional<std::string> findings = Value(reader.FindFindings(session));
  if (findings) dump += fmt::format("session {} findings crc {}\n", session.value(), Crc32c(*findings));
  return dump;
}

std::string DumpFrames(MapReader& reader, MapId map) {
  std::string dump;
  for (const FrameRecord& frame : Value(reader.ListFrames(map, std::nullopt))) {
    dump += Describe(frame);
    dump += fmt::format(" packet {}", Value(reader.GetPacket(frame.id)).size());
    EXPECT_EQ(Value(reader.FindFrame(frame.session, frame.number)), frame.id);
    for (const Observation& observation : Value(reader.GetObservations(frame.id))) {
      dump += fmt::format(" {}->{} {}", observation.feature_idx, observation.point.value(), observation.depth_m);
    }
    dump += '\n';
  }
  const Aabb box(Eigen::Vector3d(-10, -1, -1), Eigen::Vector3d(10, 1, 1));
  for (const FrameRecord& frame : Value(reader.FramesInBox(map, box)))
    dump += fmt::format("in box {}\n", frame.id.value());
  return dump;
}

std::string DumpPoints(std::vector<PointRecord> points) {
  std::sort(points.begin(), points.end(), [](const auto& a, const auto& b) { return a.id < b.id; });
  std::string dump;
  for (const PointRecord& point : points) dump += Describe(point);
  return dump;
}

std::string DumpSession(MapReader& reader, const SessionRecord& session) {
  std::string dump = Describe(session);
  dump += DumpPoints(Value(reader.PointsOfSession(session.id)));
  std::vector<uint64_t> numbers(50);
  std::iota(numbers.begin(), numbers.end(), 0);
  for (const std::optional<MapPointId>& point : Value(reader.FindSessionPoints(session.id, numbers))) {
    dump += Describe(point) + ' ';
  }
  return dump + '\n';
}

std::string DumpCounters(const PointRecord& point) {
  std::string dump = fmt::format(
      "point {} direction {} {} {} descriptor {} reference {} observations {} confidence {} observers",
      point.id.value(), point.view_direction.x(), point.view_direction.y(), point.view_direction.z(),
      Crc32c(point.descriptor.Bytes()), point.reference_distance_m, point.num_observations, point.confidence);
  for (const FrameId frame : point.observers) dump += fmt::format(" {}", frame.value());
  return dump + '\n';
}

/// What reads AS OF a revision need not tell as it was.
std::string DumpUnversioned(MapReader& reader, const MapRecord& map) {
  std::string dump = fmt::format("features {} {} {} oldest {}\n", map.features.descriptor_kind,
                                 map.features.scale_factor, map.features.patch_size_px, map.oldest_revision.value());
  for (const FrameRecord& frame : Value(reader.ListFrames(map.id, std::nullopt))) {
    dump += fmt::format("frame {} camera {} stamp {} partial {} overlap {} features {} bytes {} crc {}\n",
                        frame.id.value(), frame.camera.value(), frame.stamp_ns, frame.partial, Describe(frame.overlap),
                        frame.num_features, frame.num_packet_bytes, Crc32c(Value(reader.GetPacket(frame.id))));
  }
  for (const TileRecord& tile : Value(reader.ListTiles(map.id, std::nullopt))) {
    dump += fmt::format("tile {} revision {}\n", tile.key.ToString(), tile.revision.value());
    std::vector<PointRecord> points = Value(reader.PointsInTile(map.id, tile.key));
    std::sort(points.begin(), points.end(), [](const auto& a, const auto& b) { return a.id < b.id; });
    for (const PointRecord& point : points) dump += DumpCounters(point);
    const std::optional<TileBlob> blob = Value(reader.GetTileBlob(map.id, tile.key));
    if (blob) dump += fmt::format("blob of revision {} crc {}\n", blob->revision.value(), Crc32c(blob->bytes));
  }
  for (const TagRecord& tag : Value(reader.ListTags(map.id))) {
    dump += fmt::format("tag {} revision {} made {}\n", tag.name, tag.revision.value(), tag.created_ns);
  }
  for (const SessionRecord& session : Value(reader.ListSessions(map.id))) dump += DumpEvidence(reader, session.id);
  for (const ChangeRecord& change : Value(reader.ListChanges(map.id))) dump += Describe(change);
  for (const std::string& block : Value(reader.ListPlaceBlocks(map.id))) dump += fmt::format("block {}\n", block);
  for (const RevisionRecord& revision : Value(reader.ListRevisions(map.id, Revision(0), map.revision))) {
    dump += fmt::format("revision {} made {}\n", revision.revision.value(), revision.committed_ns);
  }
  return dump;
}

}  // namespace

std::string DumpMap(MapReader& reader, MapId map) {
  const MapRecord record = Value(reader.GetMap(map));
  std::string dump = Describe(record);
  for (const SessionRecord& session : Value(reader.ListSessions(map))) dump += DumpSession(reader, session);
  dump += DumpFrames(reader, map);
  for (const TileRecord& tile : Value(reader.ListTiles(map, std::nullopt))) {
    dump += fmt::format("tile {} points {}\n", tile.key.ToString(), tile.num_points);
    dump += DumpPoints(Value(reader.PointsInTile(map, tile.key)));
  }
  for (const RevisionRecord& revision : Value(reader.ListRevisions(map, Revision(0), record.revision))) {
    dump += fmt::format("revision {} cause {} session {}\n", revision.revision.value(),
                        static_cast<int>(revision.cause), Describe(revision.session));
  }
  return dump;
}

std::string DumpAll(MapReader& reader) {
  std::string dump;
  for (const MapRecord& map : Value(reader.ListMaps())) {
    EXPECT_EQ(Value(reader.FindMap(map.name)).id, map.id);
    dump += DumpMap(reader, map.id) + DumpUnversioned(reader, map);
  }
  for (const SessionRecord& session : Value(reader.ListSessions(std::nullopt))) {
    EXPECT_EQ(Describe(Value(reader.GetSession(session.id))), Describe(session));
    const Camera camera = Value(reader.GetCamera(session.camera)).camera;
    dump += fmt::format("session {} camera {} {} {} {} {}\n", session.id.value(), session.camera.value(),
                        ModelName(camera.projection), camera.width_px, camera.height_px, camera.stereo_baseline_m);
  }
  return dump;
}

}  // namespace mapp
