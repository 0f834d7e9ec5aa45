#include "client_sdk/src/shared_tiles.h"

#include "mapp/base/bytes.h"
#include "mapp/codec/tile_codec.h"
#include "synthetic_views.h"
#include "test_folder.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

namespace mapp {
namespace {

using testing::ElementsAre;
using testing::IsEmpty;
using testing::SizeIs;

constexpr double kAnywhereM = 1e4;
const MapIdentity kMap{.id = MapId(1), .created_ns = 5};

Tile TileAt(int32_t x, Revision revision, int num_points = 10) {
  Tile tile = TestTile(revision, num_points);
  tile.key.x = x;
  for (TilePoint& point : tile.points) point.p_map.x() += static_cast<float>(x * kDefaultTileEdgeM);
  return tile;
}

/// An answer that brings these tiles.
ClientSharedMap Bringing(const std::vector<Tile>& tiles) {
  ClientSharedMap answer;
  for (const Tile& tile : tiles) answer.tiles.push_back({tile, EncodeTile(tile)});
  return answer;
}

class SharedTilesTest : public ::testing::Test {
 protected:
  std::unique_ptr<TileFolder> OpenFolder() { return TileFolder::Open({.folder = folder_.path()}, kMap).value(); }
  /// Tiles of a session that begins, with the folder.
  SharedTiles WithFolder(double edge_m = kDefaultTileEdgeM) {
    return SharedTiles(edge_m, 10, TestCamera(), OpenFolder());
  }
  static SharedTiles InMemory(size_t max_tiles = 10) { return SharedTiles(kDefaultTileEdgeM, max_tiles, TestCamera()); }
  static std::vector<int32_t> HeldX(SharedTiles& tiles, const Eigen::Vector3d& p_map = Eigen::Vector3d::Zero(),
                                    double reach_m = kAnywhereM) {
    std::vector<int32_t> x;
    for (const ClientHeldTile& held : tiles.Held(p_map, reach_m)) x.push_back(held.key.x);
    return x;
  }
  /// A session before this one that received the tiles.
  void Earlier(const std::vector<Tile>& received) {
    SharedTiles tiles = WithFolder();
    tiles.Take(Bringing(received), {});
    ASSERT_TRUE(tiles.StoreNew().ok());
  }

  TestFolder folder_;
};

TEST_F(SharedTilesTest, ATileIsFoundOnceItIsDecoded) {
  Earlier({TileAt(1, Revision(3))});
  SharedTiles tiles = WithFolder();
  EXPECT_EQ(tiles.Find({1, 0, 0}), nullptr);
  const std::vector<ClientHeldTile> held = tiles.Held(Eigen::Vector3d::Zero(), kAnywhereM);
  EXPECT_EQ(tiles.Find({1, 0, 0}), nullptr) << "only its bytes are here";
  tiles.Take({.tiles = {}, .unchanged_held = {0}, .outdated_held = {}, .first_tile_after = {}}, held);
  ASSERT_NE(tiles.Find({1, 0, 0}), nullptr);
  EXPECT_EQ(tiles.Find({1, 0, 0})->revision, Revision(3));
}

TEST_F(SharedTilesTest, PointsComeInTheSessionsFrame) {
  SharedTiles tiles = InMemory();
  const Tile tile = TestTile(Revision(3), 5);
  const auto taken = tiles.Take(Bringing({tile}), {});
  const Pose3 T_map_session(Eigen::Quaterniond(Eigen::AngleAxisd(0.5, Eigen::Vector3d::UnitY())), {1, 2, 3});
  const auto map = tiles.MapOf(taken.keys, T_map_session, 4);
  EXPECT_EQ(map->number, 4U);
  ASSERT_THAT(map->points, SizeIs(5));
  for (size_t i = 0; i < map->points.size(); ++i) {
    const SharedPoint& point = map->points[i];
    EXPECT_EQ(point.id, tile.points[i].id);
    EXPECT_LT((T_map_session * point.p_session - tile.points[i].p_map.cast<double>()).norm(), 1e-6);
    const Eigen::Vector3d direction_map = T_map_session.rotation() * point.view_direction_session.cast<double>();
    EXPECT_LT((direction_map - tile.points[i].view_direction.cast<double>()).norm(), 1e-6);
    EXPECT_FLOAT_EQ(point.reference_distance_m,
                    ReferenceFor(TestCamera().MeanFocalPx(), tile.points[i].reference_distance_m));
  }
}

TEST_F(SharedTilesTest, TheMapIsWhatWasSentAndWhatIsUnchanged) {
  SharedTiles tiles = InMemory();
  tiles.Take(Bringing({TileAt(0, Revision(1)), TileAt(1, Revision(1)), TileAt(2, Revision(1))}), {});
  const std::vector<ClientHeldTile> held = tiles.Held(Eigen::Vector3d::Zero(), kAnywhereM);
  ClientSharedMap answer = Bringing({TileAt(3, Revision(2))});
  answer.unchanged_held = {1};
  const auto taken = tiles.Take(std::move(answer), held);
  EXPECT_THAT(taken.keys, ElementsAre(TileKey{.x = 3}, TileKey{.x = 1}));
  EXPECT_EQ(taken.num_cached, 0U) << "it was received in this session";
  EXPECT_THAT(HeldX(tiles), ElementsAre(0, 1, 2, 3)) << "what was not spoken of is held on";
}

TEST_F(SharedTilesTest, NewerTilesReplaceOlderOnes) {
  SharedTiles tiles = InMemory();
  tiles.Take(Bringing({TestTile(Revision(1), 5)}), {});
  const auto taken = tiles.Take(Bringing({TestTile(Revision(2), 7)}), {});
  const auto held = tiles.Held(Eigen::Vector3d::Zero(), kAnywhereM);
  ASSERT_THAT(held, SizeIs(1));
  EXPECT_EQ(held[0].revision, Revision(2));
  EXPECT_EQ(held[0].crc32c, Crc32c(EncodeTile(TestTile(Revision(2), 7))));
  EXPECT_THAT(tiles.MapOf(taken.keys, Pose3(), 1)->points, SizeIs(7));
}

TEST_F(SharedTilesTest, OnlyTilesInReachAreNamed) {
  SharedTiles tiles = InMemory();
  tiles.Take(Bringing({TileAt(0, Revision(1)), TileAt(1, Revision(1)), TileAt(5, Revision(1))}), {});
  EXPECT_THAT(HeldX(tiles, {4, 4, 4}, 10), ElementsAre(0, 1));
  EXPECT_THAT(HeldX(tiles, {44, 4, 4}, 1), ElementsAre(5));
}

TEST_F(SharedTilesTest, OutdatedCopiesGo) {
  Earlier({TileAt(0, Revision(1)), TileAt(1, Revision(1))});
  SharedTiles tiles = WithFolder();
  const auto held = tiles.Held(Eigen::Vector3d::Zero(), kAnywhereM);
  ClientSharedMap answer;
  answer.outdated_held = {0};
  tiles.Take(std::move(answer), held);
  EXPECT_THAT(HeldX(tiles), ElementsAre(1));
  EXPECT_THAT(OpenFolder()->Keys(), ElementsAre(TileKey{.x = 1}));
}

TEST_F(SharedTilesTest, OnlyOlderTilesAreForgotten) {
  SharedTiles tiles = InMemory();
  tiles.Take(Bringing({TileAt(0, Revision(1)), TileAt(1, Revision(5))}), {});
  tiles.Forget({{TileKey{.x = 0}, Revision(3)}, {TileKey{.x = 1}, Revision(5)}, {TileKey{.x = 9}, Revision(5)}});
  EXPECT_THAT(HeldX(tiles), ElementsAre(1));
}

TEST_F(SharedTilesTest, BeyondTheLimitTheFarthestGo) {
  SharedTiles tiles = InMemory(3);
  for (int32_t x = 0; x < 6; ++x) tiles.Take(Bringing({TileAt(x, Revision(1))}), {});
  tiles.DropFarthest({44, 4, 0});
  EXPECT_THAT(HeldX(tiles), ElementsAre(3, 4, 5));
}

TEST_F(SharedTilesTest, TheNextSessionUsesWhatTheServerSaysIsUnchanged) {
  Earlier({TileAt(0, Revision(4), 20), TileAt(1, Revision(4))});
  SharedTiles tiles = WithFolder();
  const auto held = tiles.Held(Eigen::Vector3d::Zero(), kAnywhereM);
  ASSERT_THAT(held, SizeIs(2));
  EXPECT_EQ(held[0].revision, Revision(4));
  EXPECT_EQ(held[0].crc32c, Crc32c(EncodeTile(TileAt(0, Revision(4), 20))));
  ClientSharedMap answer;
  answer.unchanged_held = {0};
  const auto taken = tiles.Take(answer, held);
  EXPECT_EQ(taken.num_cached, 1U);
  EXPECT_THAT(tiles.MapOf(taken.keys, Pose3(), 1)->points, SizeIs(20));
  EXPECT_EQ(tiles.Take(answer, held).num_cached, 0U) << "counted once";
}

TEST_F(SharedTilesTest, WhatIsFarIsNotReadFromTheFolder) {
  Earlier({TileAt(0, Revision(1)), TileAt(50, Revision(1))});
  folder_.Spoil("tile", TileKey{.x = 50}.Packed());
  SharedTiles tiles = WithFolder();
  EXPECT_THAT(HeldX(tiles, {4, 4, 4}, 20), ElementsAre(0));
  EXPECT_THAT(OpenFolder()->Keys(), SizeIs(2)) << "nobody has looked at it";
}

TEST_F(SharedTilesTest, DamagedFilesAreRemovedAndNotNamed) {
  Earlier({TileAt(0, Revision(1)), TileAt(1, Revision(1)), TileAt(2, Revision(1))});
  folder_.Spoil("tile", TileKey{.x = 0}.Packed());
  folder_.Truncate("tile", TileKey{.x = 1}.Packed());
  SharedTiles tiles = WithFolder();
  EXPECT_THAT(HeldX(tiles), ElementsAre(2));
  EXPECT_THAT(OpenFolder()->Keys(), ElementsAre(TileKey{.x = 2}));
}

TEST_F(SharedTilesTest, FilesOfAnotherFormatOrPlaceAreRemoved) {
  const auto folder = OpenFolder();
  std::string newer_format = EncodeTile(TileAt(0, Revision(1)));
  newer_format[4] = 2;
  ASSERT_TRUE(folder->Write(TileKey{.x = 0}, newer_format).ok());
  ASSERT_TRUE(folder->Write(TileKey{.x = 1}, EncodeTile(TileAt(7, Revision(1)))).ok());
  SharedTiles tiles = WithFolder();
  EXPECT_THAT(HeldX(tiles), IsEmpty());
  EXPECT_THAT(OpenFolder()->Keys(), IsEmpty());
}

TEST_F(SharedTilesTest, TilesOfAnotherGridAreRemoved) {
  Earlier({TileAt(0, Revision(1))});
  SharedTiles tiles = WithFolder(/*edge_m=*/4);
  EXPECT_THAT(HeldX(tiles), IsEmpty());
  EXPECT_THAT(OpenFolder()->Keys(), IsEmpty());
}

TEST_F(SharedTilesTest, TilesDroppedFromMemoryAreReadAgain) {
  SharedTiles tiles(kDefaultTileEdgeM, 1, TestCamera(), OpenFolder());
  tiles.Take(Bringing({TileAt(0, Revision(1)), TileAt(5, Revision(1))}), {});
  ASSERT_TRUE(tiles.StoreNew().ok());
  tiles.DropFarthest(Eigen::Vector3d::Zero());
  EXPECT_THAT(HeldX(tiles), ElementsAre(0, 5));
}

TEST_F(SharedTilesTest, WhatTheServerChangedGoesFromTheFolderToo) {
  Earlier({TileAt(0, Revision(1)), TileAt(1, Revision(1))});
  SharedTiles tiles = WithFolder();
  tiles.Forget({{TileKey{.x = 1}, Revision(2)}});
  EXPECT_THAT(HeldX(tiles), ElementsAre(0));
  EXPECT_THAT(OpenFolder()->Keys(), ElementsAre(TileKey{.x = 0}));
}

TEST_F(SharedTilesTest, WhatCannotBeStoredIsToldAndUsedAllTheSame) {
  SharedTiles tiles = WithFolder();
  folder_.ReplaceByFile();
  const auto taken = tiles.Take(Bringing({TileAt(0, Revision(1))}), {});
  EXPECT_FALSE(tiles.StoreNew().ok());
  EXPECT_TRUE(tiles.StoreNew().ok()) << "not tried again";
  EXPECT_THAT(tiles.MapOf(taken.keys, Pose3(), 1)->points, SizeIs(10));
}

}  // namespace
}  // namespace mapp
