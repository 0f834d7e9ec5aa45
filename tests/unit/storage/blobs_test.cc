#include "storage/sqlite/blobs.h"

#include "mapp/base/rng.h"
#include "tests/unit/storage/store_fixture.h"

namespace mapp::sqlite {
namespace {

std::vector<Observation> RandomObservations(uint64_t seed, size_t count) {
  Rng rng(seed);
  std::vector<Observation> observations(count);
  for (Observation& observation : observations) {
    observation = {.feature_idx = static_cast<uint16_t>(rng.Below(65536)),
                   .point = MapPointId(rng.Next() >> rng.Below(64)),
                   .depth_m = static_cast<float>(rng.Uniform(0, 50))};
  }
  return observations;
}

TEST(ObservationsBlobTest, DecodesWhatItEncodes) {
  for (uint64_t seed = 0; seed < 20; ++seed) {
    const std::vector<Observation> observations = RandomObservations(seed, seed * 7);
    const std::vector<Observation> decoded = Value(DecodeObservations(EncodeObservations(observations)));
    ASSERT_EQ(decoded.size(), observations.size()) << "seed " << seed;
    for (size_t i = 0; i < decoded.size(); ++i) {
      EXPECT_EQ(decoded[i].feature_idx, observations[i].feature_idx) << "seed " << seed;
      EXPECT_EQ(decoded[i].point, observations[i].point) << "seed " << seed;
      EXPECT_EQ(decoded[i].depth_m, observations[i].depth_m) << "seed " << seed;
    }
  }
}

TEST(ObservationsBlobTest, IsSmallForNeighboringFeaturesAndPoints) {
  std::vector<Observation> observations(500);
  for (size_t i = 0; i < observations.size(); ++i) {
    observations[i] = {.feature_idx = static_cast<uint16_t>(2 * i), .point = MapPointId(1'000'000 + i), .depth_m = 2};
  }
  EXPECT_LT(EncodeObservations(observations).size(), 6 * observations.size() + 16);
}

TEST(ObservationsBlobTest, ReportsEveryDamagedByte) {
  const std::string good = EncodeObservations(RandomObservations(1, 10));
  for (size_t i = 0; i < good.size(); ++i) {
    std::string damaged = good;
    damaged[i] = static_cast<char>(damaged[i] ^ 0x10);
    EXPECT_THAT(DecodeObservations(damaged), HasCode(absl::StatusCode::kDataLoss)) << "byte " << i;
    EXPECT_THAT(DecodeObservations(good.substr(0, i)), HasCode(absl::StatusCode::kDataLoss)) << "cut at " << i;
  }
}

TEST(ObserversBlobTest, DecodesWhatItEncodes) {
  const std::vector<FrameId> observers = {FrameId(1), FrameId(300), FrameId(uint64_t{1} << 40)};
  std::vector<FrameId> decoded;
  EXPECT_TRUE(DecodeObservers(EncodeObservers(observers), &decoded));
  EXPECT_EQ(decoded, observers);
  EXPECT_FALSE(DecodeObservers("\xff", &decoded));
}

TEST(AscendingIdsBlobTest, DecodesWhatItEncodes) {
  const std::vector<MapPointId> ids = {MapPointId(1), MapPointId(300), MapPointId(301), MapPointId(UINT64_MAX)};
  std::vector<MapPointId> decoded;
  EXPECT_TRUE(DecodeAscendingIds(EncodeAscendingIds(ids), &decoded));
  EXPECT_EQ(decoded, ids);
  EXPECT_TRUE(EncodeAscendingIds(std::vector<MapPointId>()).empty());
}

TEST(AscendingIdsBlobTest, RefusesWhatNoEncoderWrites) {
  const std::string past_the_end = EncodeAscendingIds(std::vector<MapPointId>{MapPointId(UINT64_MAX)}) + "\x02";
  for (const std::string& bytes : {std::string("\0", 1), std::string("\5\0", 2), std::string("\x80"), past_the_end}) {
    std::vector<MapPointId> decoded;
    EXPECT_FALSE(DecodeAscendingIds(bytes, &decoded)) << bytes.size() << " bytes";
  }
}

}  // namespace
}  // namespace mapp::sqlite
