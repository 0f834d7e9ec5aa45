#include "mapp/codec/tile_codec.h"

#include "mapp/base/bytes.h"
#include "mapp/base/rng.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

namespace mapp {
namespace {

Tile RandomTile(uint64_t seed, int num_points) {
  Rng rng(seed);
  Tile tile;
  tile.key = {static_cast<int32_t>(rng.Below(100)) - 50, static_cast<int32_t>(rng.Below(100)) - 50, -1};
  tile.revision = Revision(rng.Below(1'000'000));
  const Aabb box = TileGrid{tile.edge_m}.BoxOf(tile.key);
  for (int i = 0; i < 12; ++i) {
    Eigen::Matrix<double, 6, 1> tangent;
    for (int k = 0; k < 6; ++k) tangent[k] = rng.Normal();
    tile.frames.push_back({FrameId(100 + rng.Below(1000)), Pose3::Exp(tangent), 1.1F});
  }
  uint64_t id = 1000;
  for (int i = 0; i < num_points; ++i) {
    TilePoint point;
    point.id = MapPointId(id += 1 + rng.Below(9));
    for (int k = 0; k < 3; ++k) {
      point.p_map[k] = static_cast<float>(box.min()[k] + rng.Uniform(0.01, tile.edge_m - 0.01));
    }
    for (uint64_t& word : point.descriptor.words) word = rng.Next();
    point.view_direction = Eigen::Vector3d(rng.Normal(), rng.Normal(), rng.Normal()).normalized().cast<float>();
    point.reference_distance_m = static_cast<float>(rng.Uniform(0.1, 40));
    point.num_observations = static_cast<uint16_t>(1 + rng.Below(30));
    point.confidence = static_cast<float>(rng.Uniform());
    for (uint64_t n = rng.Below(TilePoint::kMaxObservers + 1); n > 0; --n) {
      point.observers.push_back(static_cast<uint16_t>(rng.Below(tile.frames.size())));
    }
    tile.points.push_back(point);
  }
  return tile;
}

TEST(TileCodecTest, RoundTripLosesNoMoreThanDocumented) {
  for (uint64_t seed = 1; seed <= 20; ++seed) {
    SCOPED_TRACE(seed);
    const Tile sent = RandomTile(seed, 200);
    const StatusOr<Tile> got = DecodeTile(EncodeTile(sent));
    ASSERT_TRUE(got.ok()) << got.status();
    EXPECT_THAT(CheckConsistency(*got), ::testing::IsEmpty());
    EXPECT_EQ(got->key, sent.key);
    EXPECT_EQ(got->revision, sent.revision);
    ASSERT_EQ(got->frames.size(), sent.frames.size());
    for (size_t i = 0; i < sent.frames.size(); ++i) {
      EXPECT_EQ(got->frames[i].id, sent.frames[i].id);
      EXPECT_LT(Distance(got->frames[i].T_map_camera, sent.frames[i].T_map_camera), 1e-9);
      EXPECT_LT(RotationAngle(got->frames[i].T_map_camera, sent.frames[i].T_map_camera), 1e-6);
    }
    ASSERT_EQ(got->points.size(), sent.points.size());
    for (size_t i = 0; i < sent.points.size(); ++i) {
      const TilePoint& a = sent.points[i];
      const TilePoint& b = got->points[i];
      EXPECT_EQ(b.id, a.id);
      EXPECT_LT((b.p_map - a.p_map).cwiseAbs().maxCoeff(), 0.5 * sent.edge_m / 65535 + 1e-4);
      EXPECT_EQ(b.descriptor, a.descriptor);
      EXPECT_GT(b.view_direction.dot(a.view_direction), std::cos(1.5 * M_PI / 180));
      EXPECT_NEAR(b.reference_distance_m / a.reference_distance_m, 1.0, 1e-3);
      EXPECT_EQ(b.num_observations, a.num_observations);
      EXPECT_NEAR(b.confidence, a.confidence, 0.5 / 255 + 1e-6);
      EXPECT_EQ(b.observers, a.observers);
    }
  }
}

TEST(TileHeaderTest, IsThatOfTheWholeTile) {
  for (uint64_t seed = 1; seed <= 20; ++seed) {
    Tile tile = RandomTile(seed, static_cast<int>(seed) - 1);
    tile.edge_m = seed % 2 == 0 ? 8 : 4;
    const StatusOr<TileHeader> header = DecodeTileHeader(EncodeTile(tile));
    ASSERT_TRUE(header.ok()) << header.status();
    EXPECT_EQ(header->key, tile.key);
    EXPECT_EQ(header->edge_m, tile.edge_m);
    EXPECT_EQ(header->revision, tile.revision);
  }
}

TEST(TileHeaderTest, RefusesEveryTruncationAndFlippedByteAnywhere) {
  const std::string bytes = EncodeTile(RandomTile(5, 8));
  for (size_t i = 0; i < bytes.size(); ++i) {
    EXPECT_EQ(DecodeTileHeader(bytes.substr(0, i)).status().code(), absl::StatusCode::kDataLoss) << i;
    std::string spoiled = bytes;
    spoiled[i] = static_cast<char>(spoiled[i] ^ 0x10);
    EXPECT_EQ(DecodeTileHeader(spoiled).status().code(), absl::StatusCode::kDataLoss) << i;
  }
}

TEST(TileHeaderTest, RefusesAnEdgeThatNoMapHas) {
  for (const double edge_m : {0.0, -8.0, kMaxTileEdgeM, std::nan("")}) {
    Tile tile = RandomTile(1, 0);
    tile.edge_m = edge_m;
    EXPECT_EQ(DecodeTileHeader(EncodeTile(tile)).status().code(), absl::StatusCode::kDataLoss) << edge_m;
    EXPECT_EQ(DecodeTile(EncodeTile(tile)).status().code(), absl::StatusCode::kDataLoss) << edge_m;
  }
}

TEST(TileCodecTest, EncodingAgainLosesNothingMore) {
  const Tile once = *DecodeTile(EncodeTile(RandomTile(3, 100)));
  const Tile twice = *DecodeTile(EncodeTile(once));
  for (size_t i = 0; i < once.points.size(); ++i) {
    EXPECT_EQ(twice.points[i].p_map, once.points[i].p_map);
    EXPECT_EQ(twice.points[i].view_direction, once.points[i].view_direction);
    EXPECT_EQ(twice.points[i].reference_distance_m, once.points[i].reference_distance_m);
    EXPECT_EQ(twice.points[i].confidence, once.points[i].confidence);
  }
}

TEST(TileCodecTest, APointTakesAtMost50Bytes) {
  const size_t with = EncodeTile(RandomTile(4, 1000)).size();
  const size_t without = EncodeTile(RandomTile(4, 0)).size();
  EXPECT_LE(with - without, 1000U * 50U);
}

TEST(TileCodecTest, RefusesEveryTruncationAndFlippedByte) {
  const std::string bytes = EncodeTile(RandomTile(5, 8));
  for (size_t i = 0; i < bytes.size(); ++i) {
    EXPECT_EQ(DecodeTile(bytes.substr(0, i)).status().code(), absl::StatusCode::kDataLoss) << i;
    std::string spoiled = bytes;
    spoiled[i] = static_cast<char>(spoiled[i] ^ 0x10);
    EXPECT_EQ(DecodeTile(spoiled).status().code(), absl::StatusCode::kDataLoss) << i;
  }
}

TEST(TileCodecTest, SealedGarbageNeverCrashes) {
  Rng rng(6);
  const std::string bytes = EncodeTile(RandomTile(6, 20));
  constexpr size_t kEnvelope = 13;
  for (int trial = 0; trial < 20000; ++trial) {
    std::string body = bytes.substr(kEnvelope);
    for (uint64_t flips = 1 + rng.Below(4); flips > 0; --flips) {
      body[rng.Below(body.size())] = static_cast<char>(rng.Next());
    }
    ByteWriter sealed;
    sealed.PutBytes(bytes.substr(0, 9));
    sealed.Put<uint32_t>(Crc32c(body));
    sealed.PutBytes(body);
    const StatusOr<Tile> tile = DecodeTile(sealed.bytes());
    if (!tile.ok()) {
      EXPECT_EQ(tile.status().code(), absl::StatusCode::kDataLoss);
    }
  }
}

}  // namespace
}  // namespace mapp
