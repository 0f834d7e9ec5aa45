#include "mapp/codec/keyframe_codec.h"

#include "mapp/base/bytes.h"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <numbers>

namespace mapp {
namespace {

constexpr uint32_t kMagic = 0x4b50414dU;  // "MAPK"
constexpr uint8_t kVersion = 1;

// Header flags.
constexpr uint8_t kPoseInMap = 1;
constexpr uint8_t kPartial = 2;
constexpr uint8_t kHasOverlap = 4;
constexpr uint8_t kHasRaster = 8;
constexpr uint8_t kKnownFlags = kPoseInMap | kPartial | kHasOverlap | kHasRaster;

// A feature's first byte: octave in the low four bits, what is known of its point in the next two.
constexpr uint8_t kOctaveMask = 0x0f;
constexpr uint8_t kHasSessionPoint = 0x10;
constexpr uint8_t kHasMapPoint = 0x20;

constexpr double kPixelSteps = 16.0;  // per pixel
constexpr double kDepthNearM = 0.01;
const double kLnDepthSpan = std::log(1e6);  // 0.01 m to 10 km
constexpr double kDepthSteps = 65535.0;
constexpr double kOverlapSteps = 255.0;
const double kLnRasterSpan = std::log(DepthRaster::kMaxDepthM / DepthRaster::kMinDepthM);
constexpr double kRasterSteps = 255.0;
/// A square's depth is that of a feature.
constexpr uint64_t kMaxRasterSamples = kMaxFeatures;

uint16_t EncodePixel(float px) {
  // The image's border lies half a pixel outside the first pixel's centre.
  return static_cast<uint16_t>(std::clamp(std::lround((px + 0.5) * kPixelSteps), 0L, 65535L));
}
float DecodePixel(uint16_t code) { return static_cast<float>(code / kPixelSteps - 0.5); }

uint16_t EncodeDepth(float depth_m) {
  const double share = std::log(depth_m / kDepthNearM) / kLnDepthSpan;
  return static_cast<uint16_t>(std::lround(std::clamp(share, 0.0, 1.0) * kDepthSteps));
}
float DecodeDepth(uint16_t code) {
  return static_cast<float>(kDepthNearM * std::exp(code / kDepthSteps * kLnDepthSpan));
}

uint8_t EncodeAngle(float angle) {
  const double turns = angle / (2 * std::numbers::pi);
  return static_cast<uint8_t>(std::lround((turns - std::floor(turns)) * 256.0) & 0xff);
}
float DecodeAngle(uint8_t code) { return static_cast<float>(code * 2 * std::numbers::pi / 256.0); }

void PutPose(ByteWriter& writer, const Pose3& pose) {
  for (int i = 0; i < 3; ++i) writer.Put<double>(pose.translation()[i]);
  const Eigen::Quaterniond& q = pose.rotation();
  for (const double c : {q.w(), q.x(), q.y(), q.z()}) writer.Put<double>(c);
}

StatusOr<Pose3> GetPose(ByteReader& reader) {
  Eigen::Vector3d translation;
  for (int i = 0; i < 3; ++i) translation[i] = reader.Get<double>();
  const auto w = reader.Get<double>();
  const auto x = reader.Get<double>();
  const auto y = reader.Get<double>();
  const auto z = reader.Get<double>();
  const Eigen::Quaterniond rotation(w, x, y, z);
  if (reader.failed()) return absl::InvalidArgumentError("keyframe: truncated");
  if (!translation.allFinite() || translation.cwiseAbs().maxCoeff() > kMaxCoordinateM) {
    return absl::InvalidArgumentError(
        fmt::format("keyframe.pose: coordinates must be finite and within {} m", kMaxCoordinateM));
  }
  if (!(std::abs(rotation.norm() - 1) < 1e-3)) {
    return absl::InvalidArgumentError(
        fmt::format("keyframe.pose: the quaternion must be of unit length, got {}", rotation.norm()));
  }
  return Pose3(rotation, translation);
}

void PutFeature(ByteWriter& writer, const KeyframeFeature& feature, uint64_t& previous_session_point,
                uint64_t& previous_map_point) {
  uint8_t head = feature.keypoint.octave & kOctaveMask;
  if (feature.point) {
    head |= feature.point->kind == PointReference::Kind::kSessionPoint ? kHasSessionPoint : kHasMapPoint;
  }
  writer.Put<uint8_t>(head);
  writer.Put<uint16_t>(EncodePixel(feature.keypoint.u_px));
  writer.Put<uint16_t>(EncodePixel(feature.keypoint.v_px));
  writer.Put<uint8_t>(EncodeAngle(feature.keypoint.angle));
  writer.PutBytes(feature.descriptor.Bytes());
  if (!feature.point) return;
  writer.Put<uint16_t>(EncodeDepth(feature.point->depth_m));
  writer.Put<uint8_t>(static_cast<uint8_t>(std::min<int>(feature.point->num_observations, 255)));
  uint64_t& previous =
      feature.point->kind == PointReference::Kind::kSessionPoint ? previous_session_point : previous_map_point;
  writer.PutVarint(ZigZag(static_cast<int64_t>(feature.point->id - previous)));
  previous = feature.point->id;
}

StatusOr<KeyframeFeature> GetFeature(ByteReader& reader, size_t idx, uint64_t& previous_session_point,
                                     uint64_t& previous_map_point) {
  KeyframeFeature feature;
  const auto head = reader.Get<uint8_t>();
  feature.keypoint.octave = head & kOctaveMask;
  const uint8_t point_bits = head & static_cast<uint8_t>(~kOctaveMask);
  if (feature.keypoint.octave >= kPyramidLevels) {
    return absl::InvalidArgumentError(fmt::format("keyframe.features[{}].octave: must be below {}, got {}", idx,
                                                  kPyramidLevels, feature.keypoint.octave));
  }
  if (point_bits != 0 && point_bits != kHasSessionPoint && point_bits != kHasMapPoint) {
    return absl::InvalidArgumentError(fmt::format("keyframe.features[{}].point: unknown kind {:#x}", idx, point_bits));
  }
  feature.keypoint.u_px = DecodePixel(reader.Get<uint16_t>());
  feature.keypoint.v_px = DecodePixel(reader.Get<uint16_t>());
  feature.keypoint.angle = DecodeAngle(reader.Get<uint8_t>());
  const std::string_view descriptor = reader.GetBytes(OrbDescriptor::kBytes);
  if (descriptor.size() == OrbDescriptor::kBytes) {
    feature.descriptor = OrbDescriptor::FromBytes(reinterpret_cast<const uint8_t*>(descriptor.data()));
  }
  if (point_bits == 0) return feature;
  PointReference point;
  point.depth_m = DecodeDepth(reader.Get<uint16_t>());
  point.num_observations = reader.Get<uint8_t>();
  const bool session_point = point_bits == kHasSessionPoint;
  point.kind = session_point ? PointReference::Kind::kSessionPoint : PointReference::Kind::kMapPoint;
  uint64_t& previous = session_point ? previous_session_point : previous_map_point;
  previous += static_cast<uint64_t>(UnZigZag(reader.GetVarint()));
  point.id = previous;
  if (!reader.failed() && point.num_observations == 0) {
    return absl::InvalidArgumentError(fmt::format("keyframe.features[{}].num_observations: must be at least 1", idx));
  }
  feature.point = point;
  return feature;
}

void PutRaster(ByteWriter& writer, const DepthRaster& raster) {
  writer.PutVarint(raster.samples.size());
  uint32_t next_cell = 0;
  for (const auto& [cell, depth_m] : raster.samples) {
    writer.PutVarint(cell - next_cell);
    const double share = std::log(depth_m / DepthRaster::kMinDepthM) / kLnRasterSpan;
    writer.Put<uint8_t>(static_cast<uint8_t>(std::lround(std::clamp(share, 0.0, 1.0) * kRasterSteps)));
    next_cell = cell + 1;
  }
}

StatusOr<DepthRaster> GetRaster(ByteReader& reader) {
  const uint64_t num_samples = reader.GetVarint();
  if (num_samples > kMaxRasterSamples) {
    return absl::InvalidArgumentError(
        fmt::format("keyframe.raster: at most {} samples, got {}", kMaxRasterSamples, num_samples));
  }
  DepthRaster raster;
  raster.samples.reserve(num_samples);
  uint64_t next_cell = 0;
  for (uint64_t i = 0; i < num_samples; ++i) {
    const uint64_t gap = reader.GetVarint();
    const double ln_ratio = reader.Get<uint8_t>() / kRasterSteps * kLnRasterSpan;
    if (gap > UINT32_MAX || next_cell + gap > UINT32_MAX) {
      return absl::InvalidArgumentError(fmt::format("keyframe.raster[{}].cell: does not fit 32 bits", i));
    }
    const auto depth_m = static_cast<float>(DepthRaster::kMinDepthM * std::exp(ln_ratio));
    raster.samples.push_back({static_cast<uint32_t>(next_cell + gap), std::min(depth_m, DepthRaster::kMaxDepthM)});
    next_cell += gap + 1;
  }
  return raster;
}

/// Takes magic, version and checksum off; what is left is the body.
StatusOr<std::string_view> CheckEnvelope(std::string_view bytes) {
  constexpr size_t kOverhead = sizeof(uint32_t) + 1 + sizeof(uint32_t);
  if (bytes.size() < kOverhead) {
    return absl::InvalidArgumentError(fmt::format("keyframe: truncated, {} bytes", bytes.size()));
  }
  ByteReader head(bytes);
  const auto magic = head.Get<uint32_t>();
  if (magic != kMagic)
    return absl::InvalidArgumentError(fmt::format("keyframe: not a keyframe, magic {:#010x}", magic));
  const auto version = head.Get<uint8_t>();
  if (version != kVersion) {
    return absl::InvalidArgumentError(fmt::format("keyframe.version: {} is not supported, only {}", version, kVersion));
  }
  const std::string_view covered = bytes.substr(0, bytes.size() - sizeof(uint32_t));
  const auto stored = ByteReader(bytes.substr(covered.size())).Get<uint32_t>();
  const uint32_t computed = Crc32c(covered);
  if (stored != computed) {
    return absl::InvalidArgumentError(
        fmt::format("keyframe.checksum: crc32c {:#010x} != stored {:#010x}", computed, stored));
  }
  return covered.substr(head.position());
}

}  // namespace

std::string EncodeKeyframe(const Keyframe& keyframe) {
  ByteWriter writer;
  writer.Put<uint32_t>(kMagic);
  writer.Put<uint8_t>(kVersion);
  uint8_t flags = 0;
  if (keyframe.pose_frame == PoseFrame::kMap) flags |= kPoseInMap;
  if (keyframe.partial) flags |= kPartial;
  if (keyframe.overlap) flags |= kHasOverlap;
  if (keyframe.raster) flags |= kHasRaster;
  writer.Put<uint8_t>(flags);
  writer.PutVarint(keyframe.session.value());
  writer.PutVarint(keyframe.number);
  writer.Put<int64_t>(keyframe.stamp_ns);
  PutPose(writer, keyframe.T_frame_camera);
  if (keyframe.overlap) {
    writer.Put<uint8_t>(static_cast<uint8_t>(std::lround(std::clamp(*keyframe.overlap, 0.0F, 1.0F) * kOverlapSteps)));
  }
  writer.PutVarint(keyframe.features.size());
  uint64_t previous_session_point = 0;
  uint64_t previous_map_point = 0;
  for (const KeyframeFeature& feature : keyframe.features) {
    PutFeature(writer, feature, previous_session_point, previous_map_point);
  }
  if (keyframe.raster) PutRaster(writer, *keyframe.raster);
  writer.Put<uint32_t>(Crc32c(writer.bytes()));
  return writer.Take();
}

StatusOr<Keyframe> DecodeKeyframe(std::string_view bytes) {
  MAPP_ASSIGN_OR_RETURN(const std::string_view body, CheckEnvelope(bytes));
  ByteReader reader(body);
  Keyframe keyframe;
  const auto flags = reader.Get<uint8_t>();
  if ((flags & ~kKnownFlags) != 0) {
    return absl::InvalidArgumentError(fmt::format("keyframe.flags: unknown bits in {:#04x}", flags));
  }
  keyframe.pose_frame = (flags & kPoseInMap) != 0 ? PoseFrame::kMap : PoseFrame::kSession;
  keyframe.partial = (flags & kPartial) != 0;
  keyframe.session = SessionId(reader.GetVarint());
  const uint64_t number = reader.GetVarint();
  if (number > UINT32_MAX) return absl::InvalidArgumentError("keyframe.number: does not fit 32 bits");
  keyframe.number = static_cast<uint32_t>(number);
  keyframe.stamp_ns = reader.Get<int64_t>();
  MAPP_ASSIGN_OR_RETURN(keyframe.T_frame_camera, GetPose(reader));
  if ((flags & kHasOverlap) != 0) keyframe.overlap = static_cast<float>(reader.Get<uint8_t>() / kOverlapSteps);
  const uint64_t num_features = reader.GetVarint();
  if (num_features > static_cast<uint64_t>(kMaxFeatures)) {
    return absl::InvalidArgumentError(fmt::format("keyframe.features: at most {}, got {}", kMaxFeatures, num_features));
  }
  keyframe.features.reserve(num_features);
  uint64_t previous_session_point = 0;
  uint64_t previous_map_point = 0;
  for (size_t i = 0; i < num_features; ++i) {
    MAPP_ASSIGN_OR_RETURN(KeyframeFeature feature, GetFeature(reader, i, previous_session_point, previous_map_point));
    if (reader.failed()) return absl::InvalidArgumentError(fmt::format("keyframe.features[{}]: truncated", i));
    keyframe.features.push_back(feature);
  }
  if ((flags & kHasRaster) != 0) {
    MAPP_ASSIGN_OR_RETURN(keyframe.raster, GetRaster(reader));
  }
  if (reader.failed() || reader.remaining() != 0) {
    return absl::InvalidArgumentError(
        fmt::format("keyframe: {} bytes too {}", reader.remaining(), reader.failed() ? "few" : "many"));
  }
  return keyframe;
}

std::string RenumberKeyframe(std::string_view bytes, SessionId session,
                             const std::function<uint64_t(uint64_t)>& map_point) {
  constexpr size_t kKeypointBytes = 2 * sizeof(uint16_t) + 1 + OrbDescriptor::kBytes;
  constexpr size_t kPointBytes = sizeof(uint16_t) + 1;
  constexpr size_t kStampAndPoseBytes = sizeof(int64_t) + 7 * sizeof(double);
  ByteReader reader(bytes.substr(0, bytes.size() - sizeof(uint32_t)));
  ByteWriter writer;
  writer.PutBytes(reader.GetBytes(sizeof(kMagic) + sizeof(kVersion)));
  const auto flags = reader.Get<uint8_t>();
  writer.Put<uint8_t>(flags);
  reader.GetVarint();
  writer.PutVarint(session.value());
  writer.PutVarint(reader.GetVarint());  // number
  writer.PutBytes(reader.GetBytes(kStampAndPoseBytes + ((flags & kHasOverlap) != 0 ? 1 : 0)));
  const uint64_t num_features = reader.GetVarint();
  writer.PutVarint(num_features);
  uint64_t previous_old = 0, previous_new = 0;
  for (uint64_t i = 0; i < num_features; ++i) {
    const auto head = reader.Get<uint8_t>();
    writer.Put<uint8_t>(head);
    writer.PutBytes(reader.GetBytes(kKeypointBytes));
    if ((head & ~kOctaveMask) == 0) continue;
    writer.PutBytes(reader.GetBytes(kPointBytes));
    const uint64_t difference = reader.GetVarint();
    if ((head & kHasMapPoint) == 0) {
      writer.PutVarint(difference);
      continue;
    }
    previous_old += static_cast<uint64_t>(UnZigZag(difference));
    const uint64_t point = map_point(previous_old);
    writer.PutVarint(ZigZag(static_cast<int64_t>(point - previous_new)));
    previous_new = point;
  }
  writer.PutBytes(reader.GetBytes(reader.remaining()));  // the raster
  writer.Put<uint32_t>(Crc32c(writer.bytes()));
  return writer.Take();
}

}  // namespace mapp
