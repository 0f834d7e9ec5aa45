#include "storage/sqlite/blobs.h"

#include "mapp/base/bytes.h"

#include <cstring>
#include <limits>

namespace mapp::sqlite {
namespace {

constexpr uint8_t kObservationsFormat = 1;
/// A varint each for feature and point, and the depth.
constexpr size_t kMinObservationBytes = 1 + 1 + sizeof(float);
constexpr size_t kDirectionBytes = 3 * sizeof(float);

}  // namespace

std::string EncodeObservations(std::span<const Observation> observations) {
  ByteWriter writer;
  writer.Put(kObservationsFormat);
  writer.PutVarint(observations.size());
  int64_t last_feature = 0;
  int64_t last_point = 0;
  for (const Observation& observation : observations) {
    const auto point = static_cast<int64_t>(observation.point.value());
    writer.PutVarint(ZigZag(observation.feature_idx - last_feature));
    writer.PutVarint(ZigZag(point - last_point));
    writer.Put(observation.depth_m);
    last_feature = observation.feature_idx;
    last_point = point;
  }
  writer.Put(Crc32c(writer.bytes()));
  return writer.Take();
}

StatusOr<std::vector<Observation>> DecodeObservations(std::string_view bytes) {
  const auto malformed = [] { return absl::DataLossError("observations are malformed"); };
  if (bytes.size() < sizeof(uint32_t)) return malformed();
  const std::string_view body = bytes.substr(0, bytes.size() - sizeof(uint32_t));
  if (ByteReader(bytes.substr(body.size())).Get<uint32_t>() != Crc32c(body)) {
    return absl::DataLossError("observations: checksum differs");
  }
  ByteReader reader(body);
  if (reader.Get<uint8_t>() != kObservationsFormat) return malformed();
  const uint64_t count = reader.GetVarint();
  if (count > reader.remaining() / kMinObservationBytes) return malformed();
  std::vector<Observation> observations(count);
  int64_t feature = 0;
  uint64_t point = 0;
  for (Observation& observation : observations) {
    feature += UnZigZag(reader.GetVarint());
    point += static_cast<uint64_t>(UnZigZag(reader.GetVarint()));
    if (feature < 0 || feature > std::numeric_limits<uint16_t>::max()) return malformed();
    observation = {
        .feature_idx = static_cast<uint16_t>(feature), .point = MapPointId(point), .depth_m = reader.Get<float>()};
  }
  if (reader.failed() || reader.remaining() != 0) return malformed();
  return observations;
}

std::string EncodeObservers(std::span<const FrameId> observers) {
  ByteWriter writer;
  for (const FrameId frame : observers) writer.PutVarint(frame.value());
  return writer.Take();
}

bool DecodeObservers(std::string_view bytes, std::vector<FrameId>* observers) {
  ByteReader reader(bytes);
  while (reader.remaining() > 0) {
    const FrameId frame(reader.GetVarint());
    if (reader.failed()) return false;
    observers->push_back(frame);
  }
  return true;
}

std::string_view DirectionBytes(const Eigen::Vector3f& direction) {
  return {reinterpret_cast<const char*>(direction.data()), kDirectionBytes};
}

bool DecodeDirection(std::string_view bytes, Eigen::Vector3f* direction) {
  if (bytes.size() != kDirectionBytes) return false;
  std::memcpy(direction->data(), bytes.data(), kDirectionBytes);
  return true;
}

std::string EncodeDoubles(const std::vector<double>& values) {
  ByteWriter writer;
  for (const double value : values) writer.Put(value);
  return writer.Take();
}

std::vector<double> DecodeDoubles(std::string_view bytes) {
  ByteReader reader(bytes);
  std::vector<double> values(bytes.size() / sizeof(double));
  for (double& value : values) value = reader.Get<double>();
  return values;
}

}  // namespace mapp::sqlite
