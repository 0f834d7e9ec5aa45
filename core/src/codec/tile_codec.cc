#include "mapp/codec/tile_codec.h"

#include "mapp/base/bytes.h"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <limits>

namespace mapp {
namespace {

constexpr uint32_t kMagic = 0x5450414dU;  // "MAPT"
constexpr uint8_t kVersion = 1;
constexpr size_t kEnvelopeBytes = sizeof(uint32_t) + 1 + sizeof(uint32_t) + sizeof(uint32_t);
/// Smallest encoded point and frame: bounds a count before memory is reserved for it.
constexpr size_t kMinPointBytes = OrbDescriptor::kBytes + 6 + 2 + 2 + 1 + 1 + 1 + 1;
constexpr size_t kMinFrameBytes = 1 + 3 * sizeof(double) + 4 * sizeof(float) + sizeof(float);

constexpr double kDirectionSteps = 127.0;
constexpr double kNearestReferenceM = 1e-3;
const double kLnReferenceSpan = std::log(1e9);
constexpr double kReferenceSteps = 65535.0;

/// Octahedral map of a unit vector to two bytes (Cigolle et al. 2014): at most about a degree off.
void PutDirection(ByteWriter& writer, const Eigen::Vector3f& direction) {
  const double sum = direction.cwiseAbs().sum();
  Eigen::Vector3d n = sum > 0 ? Eigen::Vector3d(direction.cast<double>() / sum) : Eigen::Vector3d::UnitZ();
  Eigen::Vector2d folded = n.head<2>();
  if (n.z() < 0) {
    folded =
        Eigen::Vector2d((1 - std::abs(n.y())) * (n.x() >= 0 ? 1 : -1), (1 - std::abs(n.x())) * (n.y() >= 0 ? 1 : -1));
  }
  writer.Put<int8_t>(static_cast<int8_t>(std::lround(folded.x() * kDirectionSteps)));
  writer.Put<int8_t>(static_cast<int8_t>(std::lround(folded.y() * kDirectionSteps)));
}

Eigen::Vector3f GetDirection(ByteReader& reader) {
  const double x = reader.Get<int8_t>() / kDirectionSteps;
  const double y = reader.Get<int8_t>() / kDirectionSteps;
  Eigen::Vector3d n(x, y, 1 - std::abs(x) - std::abs(y));
  if (n.z() < 0) {
    n.x() = (1 - std::abs(y)) * (x >= 0 ? 1 : -1);
    n.y() = (1 - std::abs(x)) * (y >= 0 ? 1 : -1);
  }
  const double norm = n.norm();
  return norm > 0 ? Eigen::Vector3f((n / norm).cast<float>()) : Eigen::Vector3f::UnitZ();
}

/// Positions are steps of edge / 65535 from the tile's corner: 0.12 mm for an edge of 8 m.
void PutPosition(ByteWriter& writer, const Eigen::Vector3f& p_map, const Aabb& box, double edge_m) {
  for (int i = 0; i < 3; ++i) {
    const double share = (static_cast<double>(p_map[i]) - box.min()[i]) / edge_m;
    writer.Put<uint16_t>(static_cast<uint16_t>(std::lround(std::clamp(share, 0.0, 1.0) * 65535.0)));
  }
}

Eigen::Vector3f GetPosition(ByteReader& reader, const Aabb& box, double edge_m) {
  Eigen::Vector3d p_map;
  for (int i = 0; i < 3; ++i) p_map[i] = box.min()[i] + reader.Get<uint16_t>() / 65535.0 * edge_m;
  return p_map.cast<float>();
}

uint16_t EncodeReference(float distance_m) {
  const double share =
      std::log(std::max<double>(distance_m, kNearestReferenceM) / kNearestReferenceM) / kLnReferenceSpan;
  return static_cast<uint16_t>(std::lround(std::clamp(share, 0.0, 1.0) * kReferenceSteps));
}
float DecodeReference(uint16_t code) {
  return static_cast<float>(kNearestReferenceM * std::exp(code / kReferenceSteps * kLnReferenceSpan));
}

Status Corrupt(const TileKey& key, const std::string& what) {
  return absl::DataLossError(fmt::format("tile {}: {}", key.ToString(), what));
}

/// What the envelope holds, found whole.
StatusOr<std::string_view> OpenEnvelope(std::string_view bytes) {
  ByteReader head(bytes);
  const auto magic = head.Get<uint32_t>();
  const auto version = head.Get<uint8_t>();
  const auto length = head.Get<uint32_t>();
  const auto stored_crc = head.Get<uint32_t>();
  if (head.failed()) return absl::DataLossError(fmt::format("tile: truncated, {} bytes", bytes.size()));
  if (magic != kMagic) return absl::DataLossError(fmt::format("tile: not a tile, magic {:#010x}", magic));
  if (version != kVersion) return absl::DataLossError(fmt::format("tile: version {} is not supported", version));
  if (length != bytes.size() - kEnvelopeBytes) {
    return absl::DataLossError(fmt::format("tile: length {} != stored {}", bytes.size() - kEnvelopeBytes, length));
  }
  const std::string_view body = bytes.substr(kEnvelopeBytes);
  const uint32_t crc = Crc32c(body);
  if (crc != stored_crc) {
    return absl::DataLossError(fmt::format("tile: crc32c {:#010x} != stored {:#010x}", crc, stored_crc));
  }
  return body;
}

StatusOr<TileHeader> ReadHeader(ByteReader& body) {
  TileHeader header;
  header.key = TileKey::FromPacked(body.Get<uint64_t>());
  header.edge_m = body.Get<double>();
  header.revision = Revision(body.GetVarint());
  if (body.failed()) return Corrupt(header.key, "the header is cut off");
  if (header.edge_m > 0 && header.edge_m < kMaxTileEdgeM) return header;
  return Corrupt(header.key, fmt::format("edge {} m", header.edge_m));
}

}  // namespace

std::string EncodeTile(const Tile& tile) {
  ByteWriter body;
  body.Put<uint64_t>(tile.key.Packed());
  body.Put<double>(tile.edge_m);
  body.PutVarint(tile.revision.value());
  body.PutVarint(tile.frames.size());
  body.PutVarint(tile.points.size());
  uint64_t previous = 0;
  for (const TileFrame& frame : tile.frames) {
    body.PutVarint(ZigZag(static_cast<int64_t>(frame.id.value() - previous)));
    previous = frame.id.value();
    for (int i = 0; i < 3; ++i) body.Put<double>(frame.T_map_camera.translation()[i]);
    const Eigen::Quaternionf q = frame.T_map_camera.rotation().cast<float>();
    for (const float c : {q.w(), q.x(), q.y(), q.z()}) body.Put<float>(c);
    body.Put<float>(frame.field_of_view);
  }
  const Aabb box = TileGrid{tile.edge_m}.BoxOf(tile.key);
  previous = 0;
  for (const TilePoint& point : tile.points) {
    body.PutVarint(ZigZag(static_cast<int64_t>(point.id.value() - previous)));
    previous = point.id.value();
    PutPosition(body, point.p_map, box, tile.edge_m);
    body.PutBytes(point.descriptor.Bytes());
    PutDirection(body, point.view_direction);
    body.Put<uint16_t>(EncodeReference(point.reference_distance_m));
    body.Put<uint8_t>(static_cast<uint8_t>(std::lround(std::clamp(point.confidence, 0.0F, 1.0F) * 255.0F)));
    body.PutVarint(point.num_observations);
    const size_t num_observers = std::min<size_t>(point.observers.size(), TilePoint::kMaxObservers);
    body.Put<uint8_t>(static_cast<uint8_t>(num_observers));
    for (size_t i = 0; i < num_observers; ++i) body.PutVarint(point.observers[i]);
  }
  ByteWriter writer;
  writer.Put<uint32_t>(kMagic);
  writer.Put<uint8_t>(kVersion);
  writer.Put<uint32_t>(static_cast<uint32_t>(body.size()));
  writer.Put<uint32_t>(Crc32c(body.bytes()));
  writer.PutBytes(body.bytes());
  return writer.Take();
}

StatusOr<TileHeader> DecodeTileHeader(std::string_view bytes) {
  MAPP_ASSIGN_OR_RETURN(const std::string_view body, OpenEnvelope(bytes));
  ByteReader reader(body);
  return ReadHeader(reader);
}

StatusOr<Tile> DecodeTile(std::string_view bytes) {
  MAPP_ASSIGN_OR_RETURN(const std::string_view body, OpenEnvelope(bytes));
  ByteReader reader(body);
  MAPP_ASSIGN_OR_RETURN(const TileHeader header, ReadHeader(reader));
  Tile tile;
  tile.key = header.key;
  tile.edge_m = header.edge_m;
  tile.revision = header.revision;
  const uint64_t num_frames = reader.GetVarint();
  const uint64_t num_points = reader.GetVarint();
  if (num_frames > reader.remaining() / kMinFrameBytes || num_frames > std::numeric_limits<uint16_t>::max() + 1ULL ||
      num_points > reader.remaining() / kMinPointBytes) {
    return Corrupt(tile.key, fmt::format("{} frames and {} points do not fit", num_frames, num_points));
  }
  tile.frames.reserve(num_frames);
  uint64_t previous = 0;
  for (uint64_t i = 0; i < num_frames; ++i) {
    TileFrame frame;
    previous += static_cast<uint64_t>(UnZigZag(reader.GetVarint()));
    frame.id = FrameId(previous);
    Eigen::Vector3d translation;
    for (int axis = 0; axis < 3; ++axis) translation[axis] = reader.Get<double>();
    const auto w = reader.Get<float>();
    const auto x = reader.Get<float>();
    const auto y = reader.Get<float>();
    const auto z = reader.Get<float>();
    const Eigen::Quaterniond rotation(w, x, y, z);
    if (!translation.allFinite() || !(std::abs(rotation.norm() - 1) < 1e-2)) {
      return Corrupt(tile.key, fmt::format("frame {} has a bad pose", frame.id.value()));
    }
    frame.T_map_camera = Pose3(rotation, translation);
    frame.field_of_view = reader.Get<float>();
    tile.frames.push_back(frame);
  }
  const Aabb box = TileGrid{tile.edge_m}.BoxOf(tile.key);
  tile.points.reserve(num_points);
  previous = 0;
  for (uint64_t i = 0; i < num_points; ++i) {
    TilePoint point;
    previous += static_cast<uint64_t>(UnZigZag(reader.GetVarint()));
    point.id = MapPointId(previous);
    point.p_map = GetPosition(reader, box, tile.edge_m);
    const std::string_view descriptor = reader.GetBytes(OrbDescriptor::kBytes);
    if (reader.failed()) return Corrupt(tile.key, fmt::format("point {} of {} is cut off", i, num_points));
    point.descriptor = OrbDescriptor::FromBytes(reinterpret_cast<const uint8_t*>(descriptor.data()));
    point.view_direction = GetDirection(reader);
    point.reference_distance_m = DecodeReference(reader.Get<uint16_t>());
    point.confidence = static_cast<float>(reader.Get<uint8_t>()) / 255.0F;
    point.num_observations = static_cast<uint16_t>(std::min<uint64_t>(reader.GetVarint(), UINT16_MAX));
    const auto num_observers = reader.Get<uint8_t>();
    if (num_observers > TilePoint::kMaxObservers) {
      return Corrupt(tile.key, fmt::format("point {} has {} observers", previous, num_observers));
    }
    for (int o = 0; o < num_observers; ++o) {
      const uint64_t observer = reader.GetVarint();
      if (observer >= num_frames)
        return Corrupt(tile.key, fmt::format("point {} names observer {}", previous, observer));
      point.observers.push_back(static_cast<uint16_t>(observer));
    }
    tile.points.push_back(std::move(point));
  }
  if (reader.failed() || reader.remaining() != 0) {
    return Corrupt(tile.key, fmt::format("{} bytes left over", reader.remaining()));
  }
  return tile;
}

}  // namespace mapp
