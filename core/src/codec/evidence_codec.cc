#include "mapp/codec/evidence_codec.h"

#include "bit_coder.h"
#include "mapp/base/bytes.h"
#include "mapp/base/check.h"

#include <fmt/format.h>

#include <array>
#include <bit>
#include <limits>
#include <optional>

namespace mapp {
namespace {

constexpr uint8_t kEvidenceVersion = 1;
constexpr uint64_t kMostTimes = std::numeric_limits<uint16_t>::max();

/// The sampled id of a run of kEvidenceOneIn ids. Source of the hash: the finalizer of SplitMix64.
uint64_t SampledOf(uint64_t run) {
  uint64_t hash = run + 0x9e3779b97f4a7c15ULL;
  hash = (hash ^ (hash >> 30)) * 0xbf58476d1ce4e5b9ULL;
  hash = (hash ^ (hash >> 27)) * 0x94d049bb133111ebULL;
  return run * kEvidenceOneIn + (hash ^ (hash >> 31)) % kEvidenceOneIn;
}

/// Elias-gamma code of numbers that are small most of the time: the number of binary digits in unary, then the digits;
/// each bit under its own adaptive model.
class NumberCoder {
 public:
  explicit NumberCoder(int max_digits) : max_digits_(max_digits) {}

  void Put(uint64_t number, BitEncoder& encoder) {
    const int digits = static_cast<int>(std::bit_width(number + 1)) - 1;
    for (int i = 0; i < digits; ++i) encoder.Put(true, length_[i]);
    if (digits < max_digits_) encoder.Put(false, length_[digits]);
    for (int i = digits - 1; i >= 0; --i) encoder.Put(((number + 1) >> i & 1) != 0, Digit(digits, i));
  }
  uint64_t Get(BitDecoder& decoder) {
    int digits = 0;
    while (digits < max_digits_ && decoder.Get(length_[digits])) ++digits;
    uint64_t number = 1;
    for (int i = digits - 1; i >= 0; --i) number = number << 1 | (decoder.Get(Digit(digits, i)) ? 1 : 0);
    return number - 1;
  }

 private:
  static constexpr int kMostDigits = 61;
  /// The first two digits tell something, those after them are as good as random.
  BitModel& Digit(int digits, int i) { return digits - i <= 2 ? leading_[2 * digits + (digits - i - 1)] : rest_[i]; }

  const int max_digits_;
  std::array<BitModel, kMostDigits> length_;
  std::array<BitModel, 2 * kMostDigits + 2> leading_;
  std::array<BitModel, kMostDigits> rest_;
};

/// The models of one packet; both sides go through it in the same way.
struct Coders {
  NumberCoder gap{60}, seen{16}, missed{16}, missed_unseen{16};
};

}  // namespace

bool IsInEvidenceSample(MapPointId point) {
  return point.value() != 0 && SampledOf(point.value() / kEvidenceOneIn) == point.value();
}

std::string EncodeEvidence(std::span<const PointFinding> findings) {
  Coders coders;
  BitEncoder encoder;
  uint64_t next_run = 0;
  for (const PointFinding& finding : findings) {
    MAPP_CHECK(IsInEvidenceSample(finding.point) && finding.num_seen + finding.num_missed > 0);
    const uint64_t run = finding.point.value() / kEvidenceOneIn;
    coders.gap.Put(run - next_run, encoder);
    coders.seen.Put(finding.num_seen, encoder);
    if (finding.num_seen > 0) {
      coders.missed.Put(finding.num_missed, encoder);
    } else {
      coders.missed_unseen.Put(finding.num_missed - uint64_t{1}, encoder);
    }
    next_run = run + 1;
  }
  ByteWriter writer;
  writer.Put(kEvidenceVersion);
  writer.PutVarint(findings.size());
  writer.PutBytes(std::move(encoder).Finish());
  writer.Put(Crc32c(writer.bytes()));
  return writer.Take();
}

StatusOr<std::vector<PointFinding>> DecodeEvidence(std::string_view bytes) {
  if (bytes.size() > kMaxEvidenceBytes) {
    return absl::InvalidArgumentError(
        fmt::format("evidence: at most {} bytes, got {}", kMaxEvidenceBytes, bytes.size()));
  }
  if (bytes.size() < 1 + 1 + sizeof(uint32_t)) {
    return absl::InvalidArgumentError(fmt::format("evidence: truncated, {} bytes", bytes.size()));
  }
  const std::string_view content = bytes.substr(0, bytes.size() - sizeof(uint32_t));
  const auto stored_crc = ByteReader(bytes.substr(content.size())).Get<uint32_t>();
  ByteReader reader(content);
  if (const auto version = reader.Get<uint8_t>(); version != kEvidenceVersion) {
    return absl::InvalidArgumentError(fmt::format("evidence: version {}, expected {}", version, kEvidenceVersion));
  }
  if (const uint32_t crc = Crc32c(content); crc != stored_crc) {
    return absl::InvalidArgumentError(
        fmt::format("evidence: damaged or truncated, crc32c {:#010x} != {:#010x}", crc, stored_crc));
  }
  const uint64_t count = reader.GetVarint();
  if (reader.failed() || count > kMaxEvidencePoints) {
    return absl::InvalidArgumentError(fmt::format("evidence: at most {} points, got {}", kMaxEvidencePoints, count));
  }
  Coders coders;
  BitDecoder decoder(reader.GetBytes(reader.remaining()));
  std::vector<PointFinding> findings;
  findings.reserve(count);
  uint64_t next_run = 0;
  constexpr uint64_t kNumRuns = std::numeric_limits<uint64_t>::max() / kEvidenceOneIn;
  for (uint64_t i = 0; i < count; ++i) {
    const uint64_t gap = coders.gap.Get(decoder);
    const uint64_t num_seen = coders.seen.Get(decoder);
    const uint64_t num_missed = num_seen > 0 ? coders.missed.Get(decoder) : coders.missed_unseen.Get(decoder) + 1;
    const uint64_t run = next_run + gap;
    if (gap >= kNumRuns || run >= kNumRuns || !IsInEvidenceSample(MapPointId(SampledOf(run)))) {
      return absl::InvalidArgumentError(fmt::format("evidence[{}].point: no point has such an id", i));
    }
    if (num_seen > kMostTimes || num_missed > kMostTimes) {
      return absl::InvalidArgumentError(
          fmt::format("evidence[{}]: counts must be at most {}, got {} and {}", i, kMostTimes, num_seen, num_missed));
    }
    findings.push_back(
        {MapPointId(SampledOf(run)), static_cast<uint16_t>(num_seen), static_cast<uint16_t>(num_missed)});
    next_run = run + 1;
  }
  return findings;
}

}  // namespace mapp
