#include "mapp/map/tile.h"

#include "mapp/base/rng.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

namespace mapp {
namespace {

TEST(TileKeyTest, PackingRoundTripsAndKeepsOrder) {
  Rng rng(1);
  for (int i = 0; i < 1000; ++i) {
    const auto axis = [&] { return static_cast<int32_t>(rng.Below(1 << 21)) - (1 << 20); };
    const TileKey key{axis(), axis(), axis()};
    EXPECT_EQ(TileKey::FromPacked(key.Packed()), key);
    const TileKey other{axis(), axis(), axis()};
    EXPECT_EQ(key < other, key.Packed() < other.Packed());
  }
}

TEST(TileGridTest, APointLiesInTheBoxOfItsKey) {
  Rng rng(2);
  const TileGrid grid;
  for (int i = 0; i < 1000; ++i) {
    const Eigen::Vector3d p(rng.Uniform(-1e3, 1e3), rng.Uniform(-1e3, 1e3), rng.Uniform(-1e3, 1e3));
    EXPECT_TRUE(grid.BoxOf(grid.KeyOf(p)).contains(p));
  }
  EXPECT_EQ(grid.KeyOf({-0.01, 0, 7.99}), (TileKey{-1, 0, 0}));
}

TEST(TileTest, CheckConsistencyListsEveryViolation) {
  Tile tile;
  tile.frames.push_back({FrameId(1), Pose3(), 1.0F});
  TilePoint good;
  good.id = MapPointId(1);
  good.p_map = {1, 1, 1};
  good.observers = {0};
  tile.points = {good, good, good};
  EXPECT_THAT(CheckConsistency(tile), ::testing::IsEmpty());
  tile.points[0].p_map.x() = -3;
  tile.points[1].observers = {1};
  tile.points[2].confidence = 2;
  EXPECT_THAT(CheckConsistency(tile), ::testing::SizeIs(3));
}

}  // namespace
}  // namespace mapp
