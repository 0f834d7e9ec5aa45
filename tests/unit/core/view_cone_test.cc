#include "mapp/view/view_cone.h"

#include "mapp/base/rng.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <numbers>

namespace mapp {
namespace {

ViewCone RandomCone(Rng& rng) {
  const Eigen::Quaterniond rotation(rng.Normal(), rng.Normal(), rng.Normal(), rng.Normal());
  return {Pose3(rotation, {rng.Uniform(-30, 30), rng.Uniform(-30, 30), rng.Uniform(-30, 30)}), rng.Uniform(1, 25),
          rng.Uniform(0.3, 3.0)};
}

TEST(ViewConeTest, ContainsByAngleAndRange) {
  const ViewCone cone{Pose3(), 10.0, std::numbers::pi / 2};
  EXPECT_TRUE(cone.Contains({0, 0, 9.9}));
  EXPECT_FALSE(cone.Contains({0, 0, 10.1}));
  EXPECT_TRUE(cone.Contains({4.9, 0, 5}));
  EXPECT_FALSE(cone.Contains({5.1, 0, 5}));
  EXPECT_FALSE(cone.Contains({0, 0, -1}));
}

TEST(ViewConeTest, BoundingBoxAndTilesHoldEveryPointOfTheCone) {
  Rng rng(1);
  const TileGrid grid;
  for (int trial = 0; trial < 40; ++trial) {
    const ViewCone cone = RandomCone(rng);
    const Aabb box = cone.BoundingBox();
    const std::vector<TileKey> tiles = TilesInView(cone, grid);
    for (int i = 0; i < 300; ++i) {
      const Eigen::Vector3d direction(rng.Normal(), rng.Normal(), rng.Normal());
      const Eigen::Vector3d p = cone.T_map_camera.translation() + rng.Uniform(0, cone.range_m) * direction.normalized();
      if (!cone.Contains(p)) continue;
      EXPECT_LT(box.exteriorDistance(p), 1e-9) << "trial " << trial;
      EXPECT_NE(std::find(tiles.begin(), tiles.end(), grid.KeyOf(p)), tiles.end()) << "trial " << trial;
    }
  }
}

TEST(ViewConeTest, BoundingBoxIsTightAlongTheAxis) {
  const ViewCone cone{Pose3(), 10.0, 1.0};
  const Aabb box = cone.BoundingBox();
  EXPECT_NEAR(box.max().z(), 10.0, 1e-9);
  EXPECT_NEAR(box.min().z(), 0.0, 1e-9);
  EXPECT_NEAR(box.max().x(), 10.0 * std::sin(0.5), 1e-9);
}

TEST(ViewConeTest, TilesComeNearestFirst) {
  const ViewCone cone{Pose3(Eigen::Quaterniond::Identity(), {4, 4, 4}), 20.0, 1.0};
  const TileGrid grid;
  const std::vector<TileKey> tiles = TilesInView(cone, grid);
  ASSERT_FALSE(tiles.empty());
  EXPECT_EQ(tiles.front(), grid.KeyOf({4, 4, 4}));
  double previous = 0;
  for (const TileKey& key : tiles) {
    const double distance = grid.BoxOf(key).exteriorDistance(Eigen::Vector3d(4, 4, 4));
    EXPECT_GE(distance, previous);
    previous = distance;
  }
}

TEST(ViewConeTest, NeighborsAreNearAndLookAlike) {
  const ViewCone query{Pose3(), 20.0, 1.0};
  const auto frame = [](double z, double yaw) {
    return Pose3(Eigen::Quaterniond(Eigen::AngleAxisd(yaw, Eigen::Vector3d::UnitY())), {0, 0, z});
  };
  EXPECT_TRUE(IsNeighbor(query, frame(39, 0), 1.0));
  EXPECT_FALSE(IsNeighbor(query, frame(40.1, 0), 1.0));
  EXPECT_TRUE(IsNeighbor(query, frame(0, 0.99), 1.0));
  EXPECT_FALSE(IsNeighbor(query, frame(0, 1.01), 1.0));
  EXPECT_FALSE(IsNeighbor(query, frame(0, std::numbers::pi), 1.0));
}

}  // namespace
}  // namespace mapp
