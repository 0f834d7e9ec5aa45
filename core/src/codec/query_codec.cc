#include "mapp/codec/query_codec.h"

#include "mapp/base/bytes.h"
#include "mapp/codec/occupancy_codec.h"

#include <fmt/format.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <numbers>

namespace mapp {
namespace {

// First byte: bit 0 pose frame, bits 1-2 sampler, bits 3-4 which quaternion component is left out.
constexpr uint8_t kPoseInMap = 1;
constexpr int kSamplerShift = 1;
constexpr int kLargestShift = 3;
constexpr uint8_t kTwoBits = 3;
constexpr uint8_t kUnusedBits = 0xe0;
constexpr size_t kPoseBytes = 1 + 3 * sizeof(float) + 3 * sizeof(int16_t);

constexpr double kQuaternionSteps = 32767.0;
/// The three components that are not the largest lie within this.
constexpr double kMaxSmallComponent = std::numbers::sqrt2 / 2;

/// Component left out of the smallest-three form, and the others scaled to 16 bits (q and -q are the same rotation, so
/// the one with the largest component positive is sent).
struct SmallestThree {
  uint8_t largest = 0;
  std::array<int16_t, 3> others{};
};

SmallestThree PackRotation(const Eigen::Quaterniond& rotation) {
  const std::array<double, 4> q = {rotation.w(), rotation.x(), rotation.y(), rotation.z()};
  SmallestThree packed;
  for (uint8_t i = 1; i < 4; ++i) {
    if (std::abs(q[i]) > std::abs(q[packed.largest])) packed.largest = i;
  }
  const double sign = q[packed.largest] < 0 ? -1 : 1;
  size_t out = 0;
  for (uint8_t i = 0; i < 4; ++i) {
    if (i == packed.largest) continue;
    const double share = std::clamp(sign * q[i] / kMaxSmallComponent, -1.0, 1.0);
    packed.others[out++] = static_cast<int16_t>(std::lround(share * kQuaternionSteps));
  }
  return packed;
}

/// nullopt when the components are too long for a unit quaternion.
std::optional<Eigen::Quaterniond> UnpackRotation(const SmallestThree& packed) {
  std::array<double, 4> q{};
  double squares = 0;
  size_t in = 0;
  for (uint8_t i = 0; i < 4; ++i) {
    if (i == packed.largest) continue;
    q[i] = packed.others[in++] / kQuaternionSteps * kMaxSmallComponent;
    squares += q[i] * q[i];
  }
  // The component left out is the largest, so its square is at least a quarter; rounding takes a little of it.
  if (squares > 0.75 + 1e-3) return std::nullopt;
  q[packed.largest] = std::sqrt(1 - squares);
  return Eigen::Quaterniond(q[0], q[1], q[2], q[3]);
}

bool HasSketch(SamplerKind sampler) { return sampler != SamplerKind::kUniform; }

struct AnswerEncoder {
  std::string operator()(const SampleStates& states) const { return EncodeSampleStates(states.redundant); }
  std::string operator()(const OccupancyGrid& grid) const { return EncodeOccupancy(grid); }
};

// First byte of encoded sample states: which class is listed, and how.
constexpr uint8_t kListsRedundant = 1;
constexpr uint8_t kAsMask = 2;

}  // namespace

std::string EncodeViewQuery(const ViewQuery& query) {
  const SmallestThree rotation = PackRotation(query.T_frame_camera.rotation());
  uint8_t head = query.pose_frame == PoseFrame::kMap ? kPoseInMap : 0;
  head |= static_cast<uint8_t>(static_cast<uint8_t>(query.sampler) << kSamplerShift);
  head |= static_cast<uint8_t>(rotation.largest << kLargestShift);
  ByteWriter writer;
  writer.Put<uint8_t>(head);
  for (int i = 0; i < 3; ++i) writer.Put<float>(static_cast<float>(query.T_frame_camera.translation()[i]));
  for (const int16_t component : rotation.others) writer.Put<int16_t>(component);
  if (HasSketch(query.sampler)) {
    for (const DepthSketch::Cell& cell : query.sketch.cells) {
      writer.Put<uint8_t>(cell.near_code);
      writer.Put<uint8_t>(cell.far_code);
    }
  }
  return writer.Take();
}

StatusOr<ViewQuery> DecodeViewQuery(std::string_view bytes) {
  ByteReader reader(bytes);
  const auto head = reader.Get<uint8_t>();
  ViewQuery query;
  query.pose_frame = (head & kPoseInMap) != 0 ? PoseFrame::kMap : PoseFrame::kSession;
  const uint8_t sampler = (head >> kSamplerShift) & kTwoBits;
  // Of two bits, all but 0 are samplers.
  if (!bytes.empty() && ((head & kUnusedBits) != 0 || sampler == 0)) {
    return absl::InvalidArgumentError(fmt::format("view: unknown head {:#04x}", head));
  }
  query.sampler = static_cast<SamplerKind>(sampler);
  const size_t expected = kPoseBytes + (HasSketch(query.sampler) ? 2 * DepthSketch::kCells : 0);
  if (bytes.size() != expected) {
    return absl::InvalidArgumentError(fmt::format("view: must be {} bytes, got {}", expected, bytes.size()));
  }
  Eigen::Vector3d translation;
  for (int i = 0; i < 3; ++i) translation[i] = reader.Get<float>();
  if (!translation.allFinite() || translation.cwiseAbs().maxCoeff() > kMaxCoordinateM) {
    return absl::InvalidArgumentError(
        fmt::format("view.pose: coordinates must be finite and within {} m", kMaxCoordinateM));
  }
  SmallestThree packed;
  packed.largest = (head >> kLargestShift) & kTwoBits;
  for (int16_t& component : packed.others) component = reader.Get<int16_t>();
  const std::optional<Eigen::Quaterniond> rotation = UnpackRotation(packed);
  if (!rotation) return absl::InvalidArgumentError("view.pose: the quaternion is not of unit length");
  query.T_frame_camera = Pose3(*rotation, translation);
  if (!HasSketch(query.sampler)) return query;
  for (size_t i = 0; i < query.sketch.cells.size(); ++i) {
    DepthSketch::Cell& cell = query.sketch.cells[i];
    cell.near_code = reader.Get<uint8_t>();
    cell.far_code = reader.Get<uint8_t>();
    const bool empty = cell.near_code == 0 && cell.far_code == 0;
    if (!empty && (cell.near_code == 0 || cell.far_code < cell.near_code)) {
      return absl::InvalidArgumentError(
          fmt::format("view.sketch[{}]: near {} must not exceed far {}", i, cell.near_code, cell.far_code));
    }
  }
  return query;
}

std::string EncodeSampleStates(const std::vector<bool>& redundant) {
  const auto num_redundant = static_cast<size_t>(std::count(redundant.begin(), redundant.end(), true));
  const bool list_redundant = num_redundant <= redundant.size() - num_redundant;
  const uint8_t listed_class = list_redundant ? kListsRedundant : 0;
  ByteWriter gaps;
  gaps.Put<uint8_t>(listed_class);
  size_t previous = 0;
  for (size_t i = 0; i < redundant.size(); ++i) {
    if (redundant[i] != list_redundant) continue;
    gaps.PutVarint(i - previous);
    previous = i;
  }
  const size_t mask_bytes = (redundant.size() + 7) / 8;
  if (gaps.size() <= 1 + mask_bytes) return gaps.Take();
  std::string mask(1 + mask_bytes, '\0');
  mask[0] = static_cast<char>(listed_class | kAsMask);
  for (size_t i = 0; i < redundant.size(); ++i) {
    if (redundant[i] != list_redundant) continue;
    char& byte = mask[1 + i / 8];
    byte = static_cast<char>(static_cast<uint8_t>(byte) | (1U << (i % 8)));
  }
  return mask;
}

StatusOr<std::vector<bool>> DecodeSampleStates(std::string_view bytes, size_t num_samples) {
  const auto malformed = [](const std::string& what) {
    return absl::InvalidArgumentError(fmt::format("sample_states: {}", what));
  };
  if (bytes.empty()) return malformed("empty");
  const auto head = static_cast<uint8_t>(bytes[0]);
  if ((head & ~(kListsRedundant | kAsMask)) != 0) return malformed(fmt::format("unknown head {:#04x}", head));
  const bool listed_is_redundant = (head & kListsRedundant) != 0;
  std::vector<bool> redundant(num_samples, !listed_is_redundant);
  if ((head & kAsMask) != 0) {
    if (bytes.size() != 1 + (num_samples + 7) / 8) {
      return malformed(fmt::format("a mask of {} bytes is not of {} samples", bytes.size() - 1, num_samples));
    }
    for (size_t i = 0; i < num_samples; ++i) {
      if ((static_cast<uint8_t>(bytes[1 + i / 8]) >> (i % 8) & 1) != 0) redundant[i] = listed_is_redundant;
    }
    return redundant;
  }
  ByteReader reader(bytes.substr(1));
  uint64_t index = 0;
  bool first = true;
  while (reader.remaining() > 0) {
    const uint64_t gap = reader.GetVarint();
    index = gap > num_samples ? num_samples : index + gap;
    if (reader.failed() || (!first && gap == 0) || index >= num_samples) {
      return malformed(fmt::format("a listed sample is beyond {}", num_samples));
    }
    redundant[index] = listed_is_redundant;
    first = false;
  }
  return redundant;
}

std::string EncodeOverlapAnswer(const OverlapAnswer& answer) { return std::visit(AnswerEncoder{}, answer); }

StatusOr<OverlapAnswer> DecodeOverlapAnswer(std::string_view bytes, const ViewQuery& query, size_t num_samples) {
  if (query.sampler == SamplerKind::kOccupancy) {
    MAPP_ASSIGN_OR_RETURN(OccupancyGrid grid, DecodeOccupancy(bytes, query.sketch));
    return OverlapAnswer(std::move(grid));
  }
  MAPP_ASSIGN_OR_RETURN(std::vector<bool> redundant, DecodeSampleStates(bytes, num_samples));
  return OverlapAnswer(SampleStates{std::move(redundant)});
}

}  // namespace mapp
