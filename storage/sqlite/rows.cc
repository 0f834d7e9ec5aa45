#include "storage/sqlite/rows.h"

#include "storage/checks.h"
#include "storage/sqlite/blobs.h"

#include <fmt/format.h>

namespace mapp::sqlite {
namespace {

std::string Text(const Statement& row, int column) { return std::string(row.Bytes(column)); }

template <typename T>
std::optional<T> OptionalInt(const Statement& row, int column) {
  if (row.IsNull(column)) return std::nullopt;
  return T(static_cast<T>(row.Int64(column)));
}

template <typename IdType>
std::optional<IdType> OptionalId(const Statement& row, int column) {
  if (row.IsNull(column)) return std::nullopt;
  return row.GetId<IdType>(column);
}

/// What no enumerator has (0) instead of what does not fit.
template <typename Enum>
Enum EnumOr0(int64_t value) {
  return static_cast<Enum>(value > 0 && value <= UINT8_MAX ? value : 0);
}

/// Of MAPP_CHANGE_COLUMNS.
constexpr int kFirstBoxColumn = 14;

/// NULL in the first column: there is none.
std::optional<OrientedBox> ReadBox(const Statement& row, int first_column) {
  if (row.IsNull(first_column)) return std::nullopt;
  const auto size_m = [&](int axis) { return row.Double(first_column + 7 + axis); };
  return OrientedBox{.T_frame_box = ReadPose(row, first_column), .size_m = {size_m(0), size_m(1), size_m(2)}};
}

}  // namespace

Pose3 ReadPose(const Statement& row, int first_column) {
  const auto value = [&](int offset) { return row.Double(first_column + offset); };
  return Pose3::FromStored(Eigen::Quaterniond(value(3), value(4), value(5), value(6)),
                           Eigen::Vector3d(value(0), value(1), value(2)));
}

void BindPose(Statement& statement, const Pose3& pose) {
  const Eigen::Vector3d& t = pose.translation();
  const Eigen::Quaterniond& q = pose.rotation();
  statement.Bind(t.x(), t.y(), t.z(), q.w(), q.x(), q.y(), q.z());
}

StatusOr<MapRecord> ReadMap(const Statement& row) {
  MapRecord map;
  map.id = row.GetId<MapId>(0);
  map.name = Text(row, 1);
  map.created_ns = row.Int64(2);
  map.revision = row.GetId<Revision>(3);
  map.tile_edge_m = row.Double(4);
  map.cone_range_m = row.Double(5);
  map.founder = OptionalId<SessionId>(row, 6);
  map.num_frames = row.Int64(7);
  map.num_points = row.Int64(8);
  map.num_sessions = row.Int64(9);
  map.features = {.descriptor_kind = Text(row, 10),
                  .scale_factor = static_cast<float>(row.Double(11)),
                  .num_levels = static_cast<int>(row.Int64(12)),
                  .patch_size_px = static_cast<int>(row.Int64(13))};
  map.has_metric_scale = row.Int64(14) != 0;
  map.oldest_revision = row.GetId<Revision>(15);
  if (!(map.tile_edge_m > 0)) {
    return absl::DataLossError(fmt::format("map {}: tile edge {} m is not positive", map.id.value(), map.tile_edge_m));
  }
  if (const Status status = map.features.Validate(); !status.ok()) {
    return absl::DataLossError(fmt::format("map {}: {}", map.id.value(), std::string(status.message())));
  }
  return map;
}

StatusOr<SessionRecord> ReadSession(const Statement& row) {
  SessionRecord session;
  session.id = row.GetId<SessionId>(0);
  session.map = row.GetId<MapId>(1);
  session.device = Text(row, 2);
  session.camera = row.GetId<CameraId>(3);
  const int64_t sensor = row.Int64(4);
  if (sensor < static_cast<int64_t>(SensorKind::kMono) || sensor > static_cast<int64_t>(SensorKind::kRgbd)) {
    return absl::DataLossError(fmt::format("session {}: unknown sensor kind {}", session.id.value(), sensor));
  }
  session.sensor = static_cast<SensorKind>(sensor);
  session.opened_ns = row.Int64(5);
  session.closed_ns = OptionalInt<int64_t>(row, 6);
  session.aligned_at_keyframe = OptionalInt<uint32_t>(row, 7);
  session.optimized = OptionalId<Revision>(row, 8);
  session.num_keyframes = row.Int64(9);
  session.num_upload_bytes = row.Int64(10);
  if (!row.IsNull(11)) session.T_map_session = ReadPose(row, 11);
  if (!row.IsNull(18)) session.quarantine = {row.Int64(18), Text(row, 19), OptionalInt<int64_t>(row, 20)};
  session.scale_map_session = row.Double(21);
  if (!(session.scale_map_session > 0)) {
    return absl::DataLossError(
        fmt::format("session {}: scale {} is not positive", session.id.value(), session.scale_map_session));
  }
  return session;
}

StatusOr<CameraRecord> ReadCamera(const Statement& row) {
  CameraRecord record;
  record.id = row.GetId<CameraId>(0);
  StatusOr<Projection> projection = MakeProjection(Text(row, 1), DecodeDoubles(row.Bytes(2)));
  if (!projection.ok()) {
    return absl::DataLossError(
        fmt::format("camera {}: {}", record.id.value(), std::string(projection.status().message())));
  }
  record.camera.projection = *projection;
  record.camera.width_px = static_cast<int>(row.Int64(3));
  record.camera.height_px = static_cast<int>(row.Int64(4));
  record.camera.stereo_baseline_m = row.Double(5);
  return record;
}

StatusOr<FrameRecord> ReadFrame(const Statement& row) {
  FrameRecord frame;
  frame.id = row.GetId<FrameId>(0);
  frame.map = row.GetId<MapId>(1);
  frame.session = row.GetId<SessionId>(2);
  frame.camera = row.GetId<CameraId>(3);
  frame.number = static_cast<uint32_t>(row.Int64(4));
  frame.stamp_ns = row.Int64(5);
  frame.partial = row.Int64(6) != 0;
  if (!row.IsNull(7)) frame.overlap = static_cast<float>(row.Double(7));
  frame.num_features = static_cast<uint32_t>(row.Int64(8));
  frame.num_packet_bytes = row.Int64(9);
  frame.created = row.GetId<Revision>(10);
  frame.in_map = row.Int64(11) != 0;
  frame.T_frame_camera = ReadPose(row, 12);
  if (!frame.T_frame_camera.IsFinite()) {
    return absl::DataLossError(fmt::format("frame {}: pose is not finite", frame.id.value()));
  }
  return frame;
}

StatusOr<PointRecord> ReadPoint(const Statement& row) {
  PointRecord point;
  point.id = row.GetId<MapPointId>(0);
  point.session = row.GetId<SessionId>(1);
  point.session_point = static_cast<uint64_t>(row.Int64(2));
  point.in_map = !row.IsNull(3);
  point.created = row.GetId<Revision>(4);
  point.position = {row.Double(5), row.Double(6), row.Double(7)};
  point.reference_distance_m = static_cast<float>(row.Double(10));
  point.num_observations = static_cast<uint32_t>(row.Int64(11));
  point.confidence = static_cast<float>(row.Double(12));
  const std::string_view descriptor = row.Bytes(9);
  if (descriptor.size() != OrbDescriptor::kBytes || !DecodeDirection(row.Bytes(8), &point.view_direction) ||
      !DecodeObservers(row.Bytes(13), &point.observers) || !point.position.allFinite()) {
    return absl::DataLossError(fmt::format("point {}: row is malformed", point.id.value()));
  }
  point.descriptor = OrbDescriptor::FromBytes(reinterpret_cast<const uint8_t*>(descriptor.data()));
  return point;
}

StatusOr<ChangeRecord> ReadChange(const Statement& row) {
  ChangeRecord change;
  change.id = row.GetId<ChangeId>(0);
  change.map = row.GetId<MapId>(1);
  change.kind = EnumOr0<ChangeKind>(row.Int64(2));
  change.status = EnumOr0<ChangeStatus>(row.Int64(3));
  change.confidence = row.Double(4);
  change.after_ns = row.Int64(5);
  change.before_ns = row.Int64(6);
  change.first_seen_ns = row.Int64(7);
  change.last_seen_ns = row.Int64(8);
  change.detected = row.GetId<Revision>(9);
  change.applied = OptionalId<Revision>(row, 10);
  change.box_before = ReadBox(row, kFirstBoxColumn);
  change.box_after = ReadBox(row, kFirstBoxColumn + kBoxColumns);
  const auto malformed = [&change](std::string_view what) {
    return absl::DataLossError(fmt::format("change {}: {}", change.id.value(), what));
  };
  if (!DecodeAscendingIds(row.Bytes(11), &change.sessions)) return malformed("list of sessions is malformed");
  if (!DecodeAscendingIds(row.Bytes(12), &change.points_before)) return malformed("list of points is malformed");
  if (!DecodeAscendingIds(row.Bytes(13), &change.points_after)) return malformed("list of points is malformed");
  const Status possible = internal::CheckChange(change);
  if (!possible.ok()) return malformed(std::string(possible.message()));
  return change;
}

}  // namespace mapp::sqlite
