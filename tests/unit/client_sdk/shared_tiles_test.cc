#include "client_sdk/src/shared_tiles.h"

#include "synthetic_views.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

namespace mapp {
namespace {

using testing::SizeIs;

ViewCone ConeAt(const Pose3& T_map_camera) {
  return {.T_map_camera = T_map_camera, .range_m = 20, .field_of_view = 1.3 * TestCamera().FieldOfView()};
}

Tile TileAt(int32_t x, Revision revision) {
  Tile tile = TestTile(revision, 10);
  tile.key.x = x;
  for (TilePoint& point : tile.points) point.p_map.x() += static_cast<float>(x * kDefaultTileEdgeM);
  return tile;
}

TEST(SharedTilesTest, PointsComeInTheSessionsFrame) {
  SharedTiles tiles(kDefaultTileEdgeM, 10, TestCamera());
  const Tile tile = TestTile(Revision(3), 5);
  tiles.Put({tile});
  const Pose3 T_map_session(Eigen::Quaterniond(Eigen::AngleAxisd(0.5, Eigen::Vector3d::UnitY())), {1, 2, 3});
  const auto map = tiles.MapInView(ConeAt(TestAlignment()), T_map_session, 4);
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

TEST(SharedTilesTest, TilesBehindTheCameraAreLeftOut) {
  SharedTiles tiles(kDefaultTileEdgeM, 10, TestCamera());
  tiles.Put({TestTile(Revision(1), 5)});
  const Pose3 looking_away(Eigen::Quaterniond(0, 1, 0, 0), {4, 4, -4});
  EXPECT_THAT(tiles.MapInView(ConeAt(looking_away), Pose3(), 1)->points, SizeIs(0));
}

TEST(SharedTilesTest, NewerTilesReplaceOlderOnes) {
  SharedTiles tiles(kDefaultTileEdgeM, 10, TestCamera());
  tiles.Put({TestTile(Revision(1), 5)});
  tiles.Put({TestTile(Revision(2), 7)});
  ASSERT_THAT(tiles.Held(), SizeIs(1));
  EXPECT_EQ(tiles.Held()[0].revision, Revision(2));
  EXPECT_THAT(tiles.MapInView(ConeAt(TestAlignment()), Pose3(), 1)->points, SizeIs(7));
}

TEST(SharedTilesTest, OnlyOlderTilesAreForgotten) {
  SharedTiles tiles(kDefaultTileEdgeM, 10, TestCamera());
  tiles.Put({TileAt(0, Revision(1)), TileAt(1, Revision(5))});
  tiles.Forget({{TileKey{.x = 0}, Revision(3)}, {TileKey{.x = 1}, Revision(5)}, {TileKey{.x = 9}, Revision(5)}});
  ASSERT_THAT(tiles.Held(), SizeIs(1));
  EXPECT_EQ(tiles.Held()[0].key.x, 1);
}

TEST(SharedTilesTest, BeyondTheLimitTheFarthestGo) {
  SharedTiles tiles(kDefaultTileEdgeM, 3, TestCamera());
  for (int32_t x = 0; x < 6; ++x) tiles.Put({TileAt(x, Revision(1))});
  tiles.MapInView(ConeAt(Pose3(Eigen::Quaterniond::Identity(), {44, 4, 0})), Pose3(), 1);
  ASSERT_THAT(tiles.Held(), SizeIs(3));
  for (const ClientHeldTile& held : tiles.Held()) EXPECT_GE(held.key.x, 3);
}

}  // namespace
}  // namespace mapp
