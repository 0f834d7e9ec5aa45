#include "tests/unit/storage/map_dump.h"

#include "tests/unit/storage/store_fixture.h"

#include <fmt/format.h>

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

}  // namespace mapp
