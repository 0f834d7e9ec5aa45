#include "bundle/record_codec.h"

#include "mapp/base/bytes.h"

#include <fmt/format.h>

#include <array>
#include <cmath>

namespace mapp {
namespace {

constexpr std::array kKindNames = {"map", "camera", "session", "point", "frame", "observers", "fused point", "tag"};
static_assert(kKindNames.size() == std::variant_size_v<BundleRecord>);

/// Of a stored quaternion's squared norm from 1.
constexpr double kQuaternionTolerance = 1e-6;
constexpr size_t kMaxCoefficients = 64;

// Writing.

void PutText(ByteWriter& out, std::string_view text) {
  out.PutVarint(text.size());
  out.PutBytes(text);
}

void PutFlag(ByteWriter& out, bool flag) { out.Put<uint8_t>(flag ? 1 : 0); }

void PutRigid(ByteWriter& out, const Pose3& pose) {
  const Eigen::Quaterniond& q = pose.rotation();
  for (int i = 0; i < 3; ++i) out.Put<double>(pose.translation()[i]);
  for (const double c : {q.w(), q.x(), q.y(), q.z()}) out.Put<double>(c);
}

void PutOptionalTime(ByteWriter& out, const std::optional<int64_t>& time_ns) {
  PutFlag(out, time_ns.has_value());
  if (time_ns) out.Put<int64_t>(*time_ns);
}

void Put(ByteWriter& out, const BundleMap& record) {
  const MapRecord& map = record.map;
  PutText(out, map.name);
  out.Put<int64_t>(record.exported_ns);
  out.Put<int64_t>(map.created_ns);
  out.PutVarint(map.revision.value());
  out.Put<double>(map.tile_edge_m);
  out.Put<double>(map.cone_range_m);
  out.PutVarint(map.founder ? map.founder->value() : 0);
  PutFlag(out, map.has_metric_scale);
  PutText(out, map.features.descriptor_kind);
  out.Put<float>(map.features.scale_factor);
  out.PutVarint(static_cast<uint64_t>(map.features.num_levels));
  out.PutVarint(static_cast<uint64_t>(map.features.patch_size_px));
}

void Put(ByteWriter& out, const CameraRecord& record) {
  const Camera& camera = record.camera;
  out.PutVarint(record.id.value());
  PutText(out, ModelName(camera.projection));
  const std::vector<double> coefficients = Coefficients(camera.projection);
  out.PutVarint(coefficients.size());
  for (const double coefficient : coefficients) out.Put<double>(coefficient);
  out.Put<int32_t>(camera.width_px);
  out.Put<int32_t>(camera.height_px);
  out.Put<double>(camera.stereo_baseline_m);
}

void Put(ByteWriter& out, const SessionRecord& session) {
  out.PutVarint(session.id.value());
  PutText(out, session.device);
  out.PutVarint(session.camera.value());
  out.Put<uint8_t>(static_cast<uint8_t>(session.sensor));
  out.Put<int64_t>(session.opened_ns);
  PutOptionalTime(out, session.closed_ns);
  PutFlag(out, session.T_map_session.has_value());
  if (session.T_map_session) PutRigid(out, *session.T_map_session);
  out.Put<double>(session.scale_map_session);
  PutFlag(out, session.aligned_at_keyframe.has_value());
  if (session.aligned_at_keyframe) out.Put<uint32_t>(*session.aligned_at_keyframe);
  PutFlag(out, session.optimized.has_value());
  PutFlag(out, session.quarantine.has_value());
  if (!session.quarantine) return;
  out.Put<int64_t>(session.quarantine->since_ns);
  PutText(out, session.quarantine->reason);
  PutOptionalTime(out, session.quarantine->released_ns);
}

void Put(ByteWriter& out, const PointRecord& point) {
  out.PutVarint(point.id.value());
  out.PutVarint(point.session.value());
  out.PutVarint(point.session_point);
  PutFlag(out, point.in_map);
  for (int i = 0; i < 3; ++i) out.Put<double>(point.position[i]);
  for (int i = 0; i < 3; ++i) out.Put<float>(point.view_direction[i]);
  out.PutBytes(point.descriptor.Bytes());
  out.Put<float>(point.reference_distance_m);
  out.PutVarint(point.num_observations);
  out.Put<float>(point.confidence);
}

void Put(ByteWriter& out, const BundleFrame& frame) {
  out.PutVarint(frame.id.value());
  PutFlag(out, frame.in_map);
  PutRigid(out, frame.T_frame_camera);
  out.PutVarint(frame.observations.size());
  for (const Observation& seen : frame.observations) {
    out.Put<uint16_t>(seen.feature_idx);
    out.PutVarint(seen.point.value());
    out.Put<float>(seen.depth_m);
  }
  PutText(out, frame.packet);
}

void Put(ByteWriter& out, const PointObservers& observers) {
  out.PutVarint(observers.point.value());
  out.PutVarint(observers.frames.size());
  for (const FrameId frame : observers.frames) out.PutVarint(frame.value());
}

void Put(ByteWriter& out, const FusedPoint& fused) {
  out.PutVarint(fused.session.value());
  out.PutVarint(fused.session_point);
  out.PutVarint(fused.point.value());
}

void Put(ByteWriter& out, const BundleTag& tag) { PutText(out, tag.name); }

// Reading. What is missing reads as zero; that a record has its very length is checked once, at its end.

Status Impossible(const std::string& field) { return absl::DataLossError(field + " cannot be"); }

std::string GetText(ByteReader& in) { return std::string(in.GetBytes(in.GetVarint())); }

std::optional<int64_t> GetOptionalTime(ByteReader& in) {
  if (in.Get<uint8_t>() == 0) return std::nullopt;
  return in.Get<int64_t>();
}

template <typename IdType>
IdType GetId(ByteReader& in) {
  return IdType(in.GetVarint());
}

StatusOr<Pose3> GetRigid(ByteReader& in, const char* field) {
  double v[7];
  for (double& value : v) value = in.Get<double>();
  const Eigen::Quaterniond rotation(v[3], v[4], v[5], v[6]);
  const Eigen::Vector3d translation(v[0], v[1], v[2]);
  if (in.failed()) return Pose3();
  // Written so that a NaN fails it, too.
  if (!(std::abs(rotation.squaredNorm() - 1) < kQuaternionTolerance) || !translation.allFinite()) {
    return Impossible(field);
  }
  return Pose3::FromStored(rotation, translation);
}

int GetSmallInt(ByteReader& in) { return static_cast<int>(std::min<uint64_t>(in.GetVarint(), INT32_MAX)); }

StatusOr<BundleRecord> GetMap(ByteReader& in) {
  BundleMap record;
  MapRecord& map = record.map;
  map.name = GetText(in);
  record.exported_ns = in.Get<int64_t>();
  map.created_ns = in.Get<int64_t>();
  map.revision = GetId<Revision>(in);
  map.tile_edge_m = in.Get<double>();
  map.cone_range_m = in.Get<double>();
  if (const auto founder = GetId<SessionId>(in); founder != SessionId()) map.founder = founder;
  map.has_metric_scale = in.Get<uint8_t>() != 0;
  map.features.descriptor_kind = GetText(in);
  map.features.scale_factor = in.Get<float>();
  map.features.num_levels = GetSmallInt(in);
  map.features.patch_size_px = GetSmallInt(in);
  return record;
}

StatusOr<BundleRecord> GetCamera(ByteReader& in) {
  CameraRecord record;
  record.id = GetId<CameraId>(in);
  const std::string model = GetText(in);
  const uint64_t num_coefficients = in.GetVarint();
  if (num_coefficients > kMaxCoefficients) return Impossible("number of coefficients");
  std::vector<double> coefficients(num_coefficients);
  for (double& coefficient : coefficients) coefficient = in.Get<double>();
  StatusOr<Projection> projection = MakeProjection(model, coefficients);
  if (!projection.ok()) return absl::DataLossError(std::string(projection.status().message()));
  record.camera.projection = *projection;
  record.camera.width_px = in.Get<int32_t>();
  record.camera.height_px = in.Get<int32_t>();
  record.camera.stereo_baseline_m = in.Get<double>();
  return record;
}

StatusOr<BundleRecord> GetSession(ByteReader& in) {
  SessionRecord session;
  session.id = GetId<SessionId>(in);
  session.device = GetText(in);
  session.camera = GetId<CameraId>(in);
  const auto sensor = in.Get<uint8_t>();
  if (sensor < static_cast<uint8_t>(SensorKind::kMono) || sensor > static_cast<uint8_t>(SensorKind::kRgbd)) {
    return Impossible("sensor");
  }
  session.sensor = static_cast<SensorKind>(sensor);
  session.opened_ns = in.Get<int64_t>();
  session.closed_ns = GetOptionalTime(in);
  if (in.Get<uint8_t>() != 0) {
    MAPP_ASSIGN_OR_RETURN(session.T_map_session, GetRigid(in, "T_map_session"));
  }
  session.scale_map_session = in.Get<double>();
  if (in.Get<uint8_t>() != 0) session.aligned_at_keyframe = in.Get<uint32_t>();
  if (in.Get<uint8_t>() != 0) session.optimized = Revision();
  if (in.Get<uint8_t>() != 0) {
    Quarantine quarantine;
    quarantine.since_ns = in.Get<int64_t>();
    quarantine.reason = GetText(in);
    quarantine.released_ns = GetOptionalTime(in);
    session.quarantine = std::move(quarantine);
  }
  return session;
}

StatusOr<BundleRecord> GetPoint(ByteReader& in) {
  PointRecord point;
  point.id = GetId<MapPointId>(in);
  point.session = GetId<SessionId>(in);
  point.session_point = in.GetVarint();
  point.in_map = in.Get<uint8_t>() != 0;
  for (int i = 0; i < 3; ++i) point.position[i] = in.Get<double>();
  for (int i = 0; i < 3; ++i) point.view_direction[i] = in.Get<float>();
  const std::string_view descriptor = in.GetBytes(OrbDescriptor::kBytes);
  if (descriptor.size() == OrbDescriptor::kBytes) {
    point.descriptor = OrbDescriptor::FromBytes(reinterpret_cast<const uint8_t*>(descriptor.data()));
  }
  point.reference_distance_m = in.Get<float>();
  point.num_observations = static_cast<uint32_t>(in.GetVarint());
  point.confidence = in.Get<float>();
  return point;
}

StatusOr<BundleRecord> GetFrame(ByteReader& in) {
  BundleFrame frame;
  frame.id = GetId<FrameId>(in);
  frame.in_map = in.Get<uint8_t>() != 0;
  MAPP_ASSIGN_OR_RETURN(frame.T_frame_camera, GetRigid(in, "pose"));
  const uint64_t num_observations = in.GetVarint();
  if (num_observations > static_cast<uint64_t>(kMaxFeatures)) return Impossible("number of observations");
  frame.observations.resize(num_observations);
  for (Observation& seen : frame.observations) {
    seen.feature_idx = in.Get<uint16_t>();
    seen.point = GetId<MapPointId>(in);
    seen.depth_m = in.Get<float>();
  }
  frame.packet = GetText(in);
  return frame;
}

StatusOr<BundleRecord> GetObservers(ByteReader& in) {
  PointObservers observers;
  observers.point = GetId<MapPointId>(in);
  const uint64_t num_frames = in.GetVarint();
  if (num_frames > TilePoint::kMaxObservers) return Impossible("number of frames");
  for (uint64_t i = 0; i < num_frames; ++i) observers.frames.push_back(GetId<FrameId>(in));
  return observers;
}

StatusOr<BundleRecord> GetFused(ByteReader& in) {
  FusedPoint fused;
  fused.session = GetId<SessionId>(in);
  fused.session_point = in.GetVarint();
  fused.point = GetId<MapPointId>(in);
  return fused;
}

StatusOr<BundleRecord> GetTag(ByteReader& in) { return BundleTag{GetText(in)}; }

constexpr std::array kDecoders = {GetMap, GetCamera, GetSession, GetPoint, GetFrame, GetObservers, GetFused, GetTag};
static_assert(kDecoders.size() == std::variant_size_v<BundleRecord>);

}  // namespace

uint8_t KindOf(const BundleRecord& record) { return static_cast<uint8_t>(record.index() + 1); }

const char* KindName(uint8_t kind) { return kind == 0 || kind > kKindNames.size() ? "unknown" : kKindNames[kind - 1]; }

std::string EncodeRecord(const BundleRecord& record) {
  ByteWriter out;
  std::visit([&out](const auto& it) { Put(out, it); }, record);
  return out.Take();
}

StatusOr<BundleRecord> DecodeRecord(uint8_t kind, std::string_view bytes) {
  if (kind == 0 || kind > kDecoders.size()) return absl::DataLossError(fmt::format("kind {} is unknown", kind));
  ByteReader in(bytes);
  StatusOr<BundleRecord> record = kDecoders[kind - 1](in);
  if (!in.failed() && (!record.ok() || in.remaining() == 0)) return record;
  return absl::DataLossError(fmt::format("too {}", in.failed() ? "short" : "long"));
}

void BundleCounts::Add(const BundleRecord& record) {
  struct Counter {
    BundleCounts& counts;
    void operator()(const BundleMap&) {}
    void operator()(const CameraRecord&) { ++counts.cameras; }
    void operator()(const SessionRecord&) { ++counts.sessions; }
    void operator()(const PointRecord&) { ++counts.points; }
    void operator()(const BundleFrame&) { ++counts.frames; }
    void operator()(const PointObservers&) { ++counts.observers; }
    void operator()(const FusedPoint&) { ++counts.fused; }
    void operator()(const BundleTag&) { ++counts.tags; }
  };
  std::visit(Counter{*this}, record);
}

}  // namespace mapp
