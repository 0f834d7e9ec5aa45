#include "sim/features/outlines.h"

#include "textured_world.h"

#include <gtest/gtest.h>

#include <set>
#include <vector>

namespace mapp::sim {
namespace {

/// By surface, in the world's order.
std::vector<int> NumCorners(World world) {
  std::vector<int> counts;
  for (const FeatureSurface& surface : MakeFeatureWorld(std::move(world))->At(kSecond)->surfaces) {
    int& count = counts.emplace_back(0);
    for (const OutlineCorner& corner : surface.outline) count += corner.id != 0 ? 1 : 0;
  }
  return counts;
}

TEST(OutlinesTest, PanelsMakeOneOutline) {
  World world;
  const auto texture = BrickTexture(1, 2, 3);
  for (const double x : {-2.0, 0.0, 2.0}) {
    world.surroundings.quads.push_back(WallAt(3, 2, texture));
    world.surroundings.quads.back().corner_world.x() += x;
  }
  EXPECT_EQ(NumCorners(world), (std::vector<int>{2, 0, 2}));
}

TEST(OutlinesTest, FacesOfABoxShareTheirCorners) {
  World world;
  AddBox(
      {{0, 3, 1}, {1, 1, 1}}, [](double, double) { return GrayImage(8, 8, 100); }, Lamp{.p_world = {0, 0, 0}},
      world.surroundings);
  std::set<uint64_t> ids;
  for (const FeatureSurface& surface : MakeFeatureWorld(std::move(world))->At(kSecond)->surfaces) {
    for (const OutlineCorner& corner : surface.outline) {
      EXPECT_FALSE(corner.is_flat);
      ids.insert(corner.id);
    }
  }
  EXPECT_EQ(ids.size(), 8U);
  EXPECT_FALSE(ids.contains(0));
}

TEST(OutlinesTest, AreSeenInSeveralOctavesAndOnceInEach) {
  World world;
  for (int i = 0; i < 60; ++i) {  // plain signs
    Quad sign = WallAt(3, 0.3, std::make_shared<const Texture>(GrayImage(8, 8, 200)));
    sign.corner_world += Eigen::Vector3d(-1.5 + 0.5 * (i % 7), 0, -0.31 * static_cast<double>(i / 7));
    sign.edge_v_world *= 0.08;
    world.surroundings.quads.push_back(std::move(sign));
  }
  FeatureNoise noise;
  noise.clutter_ratio = 0;
  const auto camera = FeatureCamera::Create(MakeFeatureWorld(std::move(world)), TestRig(), noise, 1);
  ASSERT_TRUE(camera.ok());
  std::set<uint64_t> landmarks;
  std::set<int> octaves;
  const auto features = (*camera)->Observe(Look(0, 0), kSecond);
  for (const ObservedFeature& feature : features) {
    landmarks.insert(feature.landmark);
    octaves.insert(feature.feature.keypoint.octave);
  }
  EXPECT_GT(features.size(), 200U);
  EXPECT_EQ(landmarks.size(), features.size());
  EXPECT_EQ(octaves.size(), static_cast<size_t>(kPyramidLevels));
}

}  // namespace
}  // namespace mapp::sim
