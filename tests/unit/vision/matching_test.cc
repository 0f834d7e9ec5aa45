#include "vision/matching.h"

#include "tests/unit/vision/synthetic.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <limits>
#include <numbers>

namespace mapp {
namespace {

using test::FlipBits;
using test::RandomDescriptor;
using test::RandomDescriptors;

Feature FeatureAt(float u_px, float v_px, int octave, const OrbDescriptor& descriptor) {
  return {.keypoint = {.u_px = u_px, .v_px = v_px, .angle = 0, .octave = static_cast<uint8_t>(octave)},
          .descriptor = descriptor};
}

FeatureGrid GridOf(const std::vector<Feature>& features) {
  std::vector<FeatureGrid::Point> points;
  for (const Feature& feature : features) points.push_back({feature.keypoint.u_px, feature.keypoint.v_px});
  return FeatureGrid(points, 640, 480);
}

TEST(MatchDescriptorsTest, FindsPlantedPairs) {
  Rng rng(1);
  const std::vector<OrbDescriptor> train = RandomDescriptors(300, rng);
  std::vector<OrbDescriptor> query;
  for (const OrbDescriptor& descriptor : train) query.push_back(FlipBits(descriptor, 30, rng));
  std::reverse(query.begin(), query.end());
  const std::vector<Match> matches = MatchDescriptors(query, train, {});
  ASSERT_EQ(matches.size(), 300U);
  for (const Match& match : matches) {
    EXPECT_EQ(match.train_idx, 299 - match.query_idx);
    EXPECT_EQ(match.distance, 30);
  }
}

TEST(MatchDescriptorsTest, FindsNothingAmongStrangers) {
  Rng rng(2);
  EXPECT_TRUE(MatchDescriptors(RandomDescriptors(200, rng), RandomDescriptors(200, rng), {}).empty());
}

TEST(MatchDescriptorsTest, AcceptsEmptySides) {
  Rng rng(3);
  const std::vector<OrbDescriptor> some = RandomDescriptors(3, rng);
  EXPECT_TRUE(MatchDescriptors({}, some, {}).empty());
  EXPECT_TRUE(MatchDescriptors(some, {}, {}).empty());
}

TEST(MatchDescriptorsTest, DistanceBoundIsInclusive) {
  Rng rng(4);
  const OrbDescriptor descriptor = RandomDescriptor(rng);
  const std::vector<OrbDescriptor> query = {FlipBits(descriptor, 64, rng)};
  const std::vector<OrbDescriptor> train = {descriptor};
  EXPECT_EQ(MatchDescriptors(query, train, {.max_distance = 64}).size(), 1U);
  EXPECT_TRUE(MatchDescriptors(query, train, {.max_distance = 63}).empty());
}

TEST(MatchDescriptorsTest, RatioTestDropsAmbiguousPairs) {
  Rng rng(5);
  const OrbDescriptor descriptor = RandomDescriptor(rng);
  const std::vector<OrbDescriptor> query = {descriptor};
  const std::vector<OrbDescriptor> train = {FlipBits(descriptor, 20, rng), FlipBits(descriptor, 22, rng)};
  EXPECT_TRUE(MatchDescriptors(query, train, {.max_ratio = 0.8}).empty());
  EXPECT_EQ(MatchDescriptors(query, train, {.max_ratio = 1.0}).size(), 1U);
  EXPECT_EQ(MatchDescriptors(query, train, {.max_ratio = 0.95}).size(), 1U);
}

TEST(MatchDescriptorsTest, MutualMatchesAreOneToOne) {
  Rng rng(6);
  const OrbDescriptor descriptor = RandomDescriptor(rng);
  const std::vector<OrbDescriptor> query = {FlipBits(descriptor, 25, rng), FlipBits(descriptor, 5, rng)};
  const std::vector<OrbDescriptor> train = {descriptor};
  EXPECT_EQ(MatchDescriptors(query, train, {.mutual = false}).size(), 2U);
  const std::vector<Match> mutual = MatchDescriptors(query, train, {.mutual = true});
  ASSERT_EQ(mutual.size(), 1U);
  EXPECT_EQ(mutual[0].query_idx, 1);
}

TEST(FeatureGridTest, FindsWhatASearchOfAllPointsFinds) {
  Rng rng(7);
  std::vector<FeatureGrid::Point> points;
  for (int i = 0; i < 500; ++i) {
    // Undistortion moves some points out of the image.
    const auto u_px = static_cast<float>(rng.Uniform(-40, 680));
    points.push_back({u_px, static_cast<float>(rng.Uniform(-40, 520))});
  }
  const FeatureGrid grid(points, 640, 480);
  for (int i = 0; i < 200; ++i) {
    const auto u_px = static_cast<float>(rng.Uniform(-60, 700));
    const auto v_px = static_cast<float>(rng.Uniform(-60, 540));
    const auto radius_px = static_cast<float>(rng.Uniform(0, 80));
    std::vector<int> found;
    grid.Find(u_px, v_px, radius_px, found);
    std::vector<int> expected;
    for (size_t k = 0; k < points.size(); ++k) {
      if (std::abs(points[k].u_px - u_px) <= radius_px && std::abs(points[k].v_px - v_px) <= radius_px) {
        expected.push_back(static_cast<int>(k));
      }
    }
    EXPECT_THAT(found, ::testing::UnorderedElementsAreArray(expected)) << "window " << i;
  }
}

TEST(FeatureGridTest, IgnoresPositionsThatAreNotNumbers) {
  constexpr float kNan = std::numeric_limits<float>::quiet_NaN();
  const std::vector<FeatureGrid::Point> points = {{kNan, 5}, {10, 10}, {5, std::numeric_limits<float>::infinity()}};
  const FeatureGrid grid(points, 640, 480);
  std::vector<int> found;
  grid.Find(10, 10, 1000, found);
  EXPECT_THAT(found, ::testing::ElementsAre(1));
  grid.Find(kNan, 10, 1000, found);
  grid.Find(10, 10, kNan, found);
  EXPECT_EQ(found.size(), 1U);
}

TEST(FeatureGridTest, EmptyGridFindsNothing) {
  std::vector<int> found;
  FeatureGrid().Find(10, 10, 100, found);
  FeatureGrid({}, 640, 480).Find(10, 10, 100, found);
  EXPECT_TRUE(found.empty());
}

TEST(MatchProjectedTest, TakesTheNearestDescriptorWithinTheRadius) {
  Rng rng(8);
  const OrbDescriptor descriptor = RandomDescriptor(rng);
  const std::vector<Feature> features = {FeatureAt(100, 100, 2, FlipBits(descriptor, 30, rng)),
                                         FeatureAt(106, 100, 2, FlipBits(descriptor, 10, rng)),
                                         FeatureAt(130, 100, 2, descriptor)};
  const std::vector<ProjectedPoint> projected = {{101, 100, 10, 2, descriptor}};
  const std::vector<Match> matches = MatchProjected(projected, GridOf(features), features, {});
  ASSERT_EQ(matches.size(), 1U);
  EXPECT_EQ(matches[0].train_idx, 1);
  EXPECT_EQ(matches[0].distance, 10);
}

TEST(MatchProjectedTest, ConsidersNeighboringOctavesOnly) {
  Rng rng(9);
  const OrbDescriptor descriptor = RandomDescriptor(rng);
  for (int octave = 0; octave < kPyramidLevels; ++octave) {
    const std::vector<Feature> features = {FeatureAt(100, 100, octave, descriptor)};
    const std::vector<ProjectedPoint> projected = {{100, 100, 10, 3, descriptor}};
    const bool is_near = std::abs(octave - 3) <= 1;
    EXPECT_EQ(MatchProjected(projected, GridOf(features), features, {}).size(), is_near ? 1U : 0U);
  }
}

TEST(MatchProjectedTest, RatioTestIgnoresRivalsOfOtherOctaves) {
  Rng rng(10);
  const OrbDescriptor descriptor = RandomDescriptor(rng);
  std::vector<Feature> features = {FeatureAt(100, 100, 2, FlipBits(descriptor, 20, rng)),
                                   FeatureAt(101, 100, 3, FlipBits(descriptor, 21, rng))};
  const std::vector<ProjectedPoint> projected = {{100, 100, 10, 2, descriptor}};
  EXPECT_EQ(MatchProjected(projected, GridOf(features), features, {}).size(), 1U);
  features[1].keypoint.octave = 2;
  EXPECT_TRUE(MatchProjected(projected, GridOf(features), features, {}).empty());
}

TEST(MatchProjectedTest, GivesAFeatureToItsNearestPoint) {
  Rng rng(11);
  const OrbDescriptor descriptor = RandomDescriptor(rng);
  const std::vector<Feature> features = {FeatureAt(100, 100, 0, descriptor)};
  const std::vector<ProjectedPoint> projected = {{100, 100, 10, 0, FlipBits(descriptor, 30, rng)},
                                                 {100, 100, 10, 0, FlipBits(descriptor, 8, rng)},
                                                 {100, 100, 10, 0, FlipBits(descriptor, 20, rng)}};
  const std::vector<Match> matches = MatchProjected(projected, GridOf(features), features, {});
  ASSERT_EQ(matches.size(), 1U);
  EXPECT_EQ(matches[0].query_idx, 1);
}

TEST(FilterByRotationTest, KeepsTheCommonTurn) {
  std::vector<Feature> query(40);
  std::vector<Feature> train(40);
  std::vector<Match> matches;
  constexpr float kTurn = 2 * std::numbers::pi_v<float>;
  for (int i = 0; i < 40; ++i) {
    const auto idx = static_cast<size_t>(i);
    query[idx].keypoint.angle = static_cast<float>(i) * kTurn / 40;
    // All turn by 0.5 rad, but four, which each turn by another angle.
    const float turn = i < 36 ? 0.5F : 1.2F * static_cast<float>(i - 34);
    train[idx].keypoint.angle = std::fmod(query[idx].keypoint.angle + turn, kTurn);
    matches.push_back({i, i, 0});
  }
  const std::vector<Match> kept = FilterByRotation(matches, query, train);
  ASSERT_EQ(kept.size(), 36U);
  for (const Match& match : kept) EXPECT_LT(match.query_idx, 36);
  EXPECT_TRUE(FilterByRotation({}, query, train).empty());
}

TEST(PredictOctaveTest, InvertsTheScaleOfTheReference) {
  for (int octave = 0; octave < kPyramidLevels; ++octave) {
    EXPECT_EQ(PredictOctave(6.0F, 6.0F / OctaveScale(octave)), octave);
  }
}

TEST(PredictOctaveTest, IsClampedToThePyramid) {
  EXPECT_EQ(PredictOctave(1.0F, 100.0F), 0);
  EXPECT_EQ(PredictOctave(100.0F, 0.1F), kPyramidLevels - 1);
  EXPECT_EQ(PredictOctave(1.0F, 0.0F), kPyramidLevels - 1);
  EXPECT_EQ(PredictOctave(0.0F, 0.0F), 0);
}

TEST(RepresentativeDescriptorTest, PrefersTheMiddleOfTheMajority) {
  Rng rng(12);
  const OrbDescriptor center = RandomDescriptor(rng);
  std::vector<OrbDescriptor> descriptors = {RandomDescriptor(rng)};
  for (int i = 0; i < 5; ++i) descriptors.push_back(FlipBits(center, 30, rng));
  descriptors.push_back(center);
  EXPECT_EQ(RepresentativeDescriptor(descriptors), 6U);
}

TEST(RepresentativeDescriptorTest, IsTheFirstOfOneOrTwo) {
  Rng rng(13);
  EXPECT_EQ(RepresentativeDescriptor(RandomDescriptors(1, rng)), 0U);
  EXPECT_EQ(RepresentativeDescriptor(RandomDescriptors(2, rng)), 0U);
}

}  // namespace
}  // namespace mapp
