#include "mapp/codec/evidence_codec.h"

#include "mapp/base/bytes.h"
#include "mapp/base/rng.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <limits>
#include <string>

namespace mapp {
namespace {

using testing::HasSubstr;
using testing::SizeIs;

/// The first sampled point from an id on.
MapPointId SampledFrom(uint64_t id) {
  while (!IsInEvidenceSample(MapPointId(id))) ++id;
  return MapPointId(id);
}

std::vector<PointFinding> SomeFindings() {
  return {{SampledFrom(1), 1, 0},
          {SampledFrom(300), 0, 17},
          {SampledFrom(316), 65535, 65535},
          {SampledFrom(5'000'000'000), 200, 1},
          {SampledFrom(std::numeric_limits<uint64_t>::max() / 2), 0, 65535}};
}

std::string RefusalOf(const std::string& packet) {
  const StatusOr<std::vector<PointFinding>> decoded = DecodeEvidence(packet);
  EXPECT_EQ(decoded.status().code(), absl::StatusCode::kInvalidArgument);
  return std::string(decoded.status().message());
}

std::string WithChecksum(std::string content) {
  ByteWriter writer;
  writer.PutBytes(content);
  writer.Put(Crc32c(content));
  return writer.Take();
}

TEST(EvidenceCodecTest, ComesBackAsItWas) {
  const StatusOr<std::vector<PointFinding>> decoded = DecodeEvidence(EncodeEvidence(SomeFindings()));
  ASSERT_TRUE(decoded.ok()) << decoded.status();
  EXPECT_EQ(*decoded, SomeFindings());
  EXPECT_EQ(DecodeEvidence(EncodeEvidence({}))->size(), 0U);
}

TEST(EvidenceCodecTest, SoDoRandomReports) {
  Rng rng(1);
  for (int round = 0; round < 200; ++round) {
    std::vector<PointFinding> findings;
    uint64_t id = 1;
    for (uint64_t i = rng.Below(300); i > 0; --i) {
      const MapPointId point = SampledFrom(id + (rng.Below(10) == 0 ? rng.Below(uint64_t{1} << 40) : rng.Below(100)));
      const auto num_seen = static_cast<uint16_t>(rng.Below(1 + rng.Below(65536)));
      const auto num_missed = static_cast<uint16_t>(rng.Below(1 + rng.Below(65536)));
      findings.push_back({point, num_seen, static_cast<uint16_t>(num_seen == 0 ? num_missed + 1 : num_missed)});
      id = point.value() + 1;
    }
    const StatusOr<std::vector<PointFinding>> decoded = DecodeEvidence(EncodeEvidence(findings));
    ASSERT_TRUE(decoded.ok()) << decoded.status();
    EXPECT_EQ(*decoded, findings);
  }
}

TEST(EvidenceCodecTest, WhatIsMostlyThereTakesHalfAByteAPoint) {
  Rng rng(1);
  std::vector<PointFinding> findings;
  for (uint64_t id = 1; findings.size() < 1000; ++id) {
    if (!IsInEvidenceSample(MapPointId(id)) || rng.Below(2) == 0) continue;
    const bool is_missed = rng.Below(30) == 0;
    findings.push_back({MapPointId(id), static_cast<uint16_t>(is_missed ? 0 : 1 + (rng.Below(10) == 0 ? 1 : 0)),
                        static_cast<uint16_t>(is_missed ? 1 : 0)});
  }
  EXPECT_LE(EncodeEvidence(findings).size(), 500U);
}

TEST(EvidenceCodecTest, RefusesEveryTruncationAndEveryFlippedBit) {
  const std::string whole = EncodeEvidence(SomeFindings());
  for (size_t length = 0; length < whole.size(); ++length) {
    EXPECT_FALSE(DecodeEvidence(whole.substr(0, length)).ok()) << length << " of " << whole.size() << " bytes";
  }
  EXPECT_FALSE(DecodeEvidence(whole + "x").ok());
  for (size_t i = 0; i < 8 * whole.size(); ++i) {
    std::string damaged = whole;
    damaged[i / 8] = static_cast<char>(damaged[i / 8] ^ (1 << (i % 8)));
    EXPECT_FALSE(DecodeEvidence(damaged).ok()) << "bit " << i;
  }
}

TEST(EvidenceCodecTest, WhateverIsForgedIsReadOrRefused) {
  Rng rng(1);
  for (int round = 0; round < 2000; ++round) {
    std::string content = {1, static_cast<char>(rng.Below(128))};
    for (uint64_t i = rng.Below(40); i > 0; --i) content.push_back(static_cast<char>(rng.Below(256)));
    const StatusOr<std::vector<PointFinding>> decoded = DecodeEvidence(WithChecksum(content));
    if (!decoded.ok()) continue;
    for (size_t i = 0; i < decoded->size(); ++i) {
      EXPECT_TRUE(IsInEvidenceSample((*decoded)[i].point));
      EXPECT_GT((*decoded)[i].num_seen + (*decoded)[i].num_missed, 0);
      if (i > 0) {
        EXPECT_LT((*decoded)[i - 1].point, (*decoded)[i].point);
      }
    }
  }
}

TEST(EvidenceCodecTest, NamesWhatIsWrong) {
  EXPECT_THAT(RefusalOf(""), HasSubstr("truncated, 0 bytes"));
  EXPECT_THAT(RefusalOf(WithChecksum({7, 0})), HasSubstr("version 7, expected 1"));
  EXPECT_THAT(RefusalOf(std::string("\x01\0\0\0\0\0", 6)), HasSubstr("crc32c"));
  EXPECT_THAT(RefusalOf(std::string(kMaxEvidenceBytes + 1, 'x')), HasSubstr("at most 131072 bytes"));
  EXPECT_THAT(RefusalOf(WithChecksum("\x01\xff\xff\xff\xff\x0f")), HasSubstr("at most 4096 points"));
  EXPECT_THAT(RefusalOf(WithChecksum("\x01\x01\xff\xff\xff\xff\xff\xff\xff\xff\xff\xff\xff\xff\xff\xff\xff\xff\xff")),
              HasSubstr("evidence[0].point"));
}

TEST(EvidenceCodecTest, TheSampleIsOneOfEachSixteenIds) {
  for (uint64_t run = 1; run < 1000; ++run) {
    size_t num = 0;
    for (uint64_t i = 0; i < kEvidenceOneIn; ++i) num += IsInEvidenceSample(MapPointId(run * kEvidenceOneIn + i));
    EXPECT_EQ(num, 1U);
  }
  for (const uint64_t stride : {2U, 16U, 17U, 1000U}) {
    size_t num = 0;
    for (uint64_t i = 1; i <= 16'000; ++i) num += IsInEvidenceSample(MapPointId(i * stride)) ? 1 : 0;
    EXPECT_NEAR(static_cast<double>(num), 1000, 100) << "every " << stride;
  }
  EXPECT_FALSE(IsInEvidenceSample(MapPointId(0)));
}

TEST(PointFindingTest, WhatIsSaidOfOnePointAddsUp) {
  const std::vector<PointFinding> said = {{MapPointId(1), 1, 2}, {MapPointId(1), 3, 65535}, {MapPointId(2), 1, 0}};
  const std::vector<PointFinding> merged = MergeFindings(said);
  ASSERT_THAT(merged, SizeIs(2));
  EXPECT_EQ(merged[0], (PointFinding{MapPointId(1), 4, 65535}));
  EXPECT_EQ(merged[1], said[2]);
}

}  // namespace
}  // namespace mapp
