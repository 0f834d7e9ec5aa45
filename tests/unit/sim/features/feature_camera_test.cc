#include "sim/features/feature_camera.h"

#include "textured_world.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <map>
#include <set>

namespace mapp::sim {
namespace {

using testing::HasSubstr;

std::unique_ptr<FeatureCamera> MakeCamera(std::shared_ptr<const FeatureWorld> world, const FeatureNoise& noise = {},
                                          uint64_t seed = 1, SensorKind sensor = SensorKind::kRgbd) {
  StatusOr<std::unique_ptr<FeatureCamera>> camera =
      FeatureCamera::Create(std::move(world), TestRig(sensor), noise, seed);
  EXPECT_TRUE(camera.ok()) << camera.status();
  return *std::move(camera);
}

FeatureNoise NoNoise() {
  FeatureNoise noise;
  noise.pixel_px = noise.angle_rad = noise.view_response_ratio = noise.image_response_ratio = 0;
  noise.random_bits = noise.view_bits = noise.scale_bits = 0;
  noise.clutter_ratio = 0;
  noise.depth_sigma_per_m = noise.disparity_px = 0;
  noise.depth_missing_ratio = noise.depth_outlier_ratio = 0;
  return noise;
}

std::map<uint64_t, ObservedFeature> ByLandmark(const std::vector<ObservedFeature>& features) {
  std::map<uint64_t, ObservedFeature> by_landmark;
  for (const ObservedFeature& feature : features) {
    if (feature.landmark != 0) by_landmark[feature.landmark] = feature;
  }
  return by_landmark;
}

/// Mean Hamming distance of the landmarks that both images show; the number of them in `num_common`.
double MeanDistance(const std::vector<ObservedFeature>& a, const std::vector<ObservedFeature>& b, size_t* num_common) {
  const auto in_b = ByLandmark(b);
  double sum = 0;
  *num_common = 0;
  for (const auto& [landmark, feature] : ByLandmark(a)) {
    const auto other = in_b.find(landmark);
    if (other == in_b.end()) continue;
    sum += HammingDistance(feature.feature.descriptor, other->second.feature.descriptor);
    ++*num_common;
  }
  return sum / static_cast<double>(*num_common);
}

TEST(FeatureCameraTest, FillsAnImageOfATexturedWallWithDistinctFeatures) {
  const auto camera = MakeCamera(MakeFeatureWorld(WallWorld()));
  const std::vector<ObservedFeature> features = camera->Observe(Look(0, 0), kSecond);
  EXPECT_LE(features.size(), 1000U);
  EXPECT_GE(features.size(), 900U);
  EXPECT_GE(ByLandmark(features).size(), 800U) << "no landmark twice";
  int num_upper_left = 0;
  for (const ObservedFeature& feature : features) {
    const Keypoint& keypoint = feature.feature.keypoint;
    EXPECT_TRUE(camera->rig().camera.Contains({keypoint.u_px, keypoint.v_px}));
    EXPECT_GE(keypoint.angle, 0);
    EXPECT_LT(keypoint.angle, 6.2832F);
    EXPECT_LT(keypoint.octave, kPyramidLevels);
    num_upper_left += keypoint.u_px < 320 && keypoint.v_px < 240 ? 1 : 0;
  }
  EXPECT_NEAR(num_upper_left, 250, 80) << "spread over the image";
}

TEST(FeatureCameraTest, SameSeedGivesTheSameFeaturesAndAnotherSeedOthers) {
  const auto world = MakeFeatureWorld(WallWorld());
  const auto first = MakeCamera(world)->Observe(Look(0, 0), kSecond);
  const auto again = MakeCamera(MakeFeatureWorld(WallWorld()))->Observe(Look(0, 0), kSecond);
  const auto other = MakeCamera(world, {}, 2)->Observe(Look(0, 0), kSecond);
  ASSERT_EQ(first.size(), again.size());
  for (size_t i = 0; i < first.size(); ++i) {
    EXPECT_EQ(first[i].landmark, again[i].landmark);
    EXPECT_EQ(first[i].feature.descriptor, again[i].feature.descriptor);
    EXPECT_EQ(first[i].feature.keypoint.u_px, again[i].feature.keypoint.u_px);
    EXPECT_EQ(first[i].depth_m, again[i].depth_m);
  }
  size_t num_common = 0;
  EXPECT_GT(MeanDistance(first, other, &num_common), 5);
  EXPECT_GT(num_common, first.size() / 2);
}

TEST(FeatureCameraTest, WithoutNoiseAFeatureLiesWhereItsLandmarkProjects) {
  const auto camera = MakeCamera(MakeFeatureWorld(WallWorld()), NoNoise());
  const Pose3 T_world_camera = Look(0.4, 0.3, 0.3);
  const std::vector<ObservedFeature> features = camera->Observe(T_world_camera, kSecond);
  ASSERT_GT(features.size(), 500U);
  for (const ObservedFeature& feature : features) {
    EXPECT_NEAR(feature.p_world.y(), 3, 1e-9) << "on the wall";
    const Eigen::Vector3d p_camera = T_world_camera.Inverse() * feature.p_world;
    const Eigen::Vector2d pixel = camera->rig().camera.Project(p_camera);
    // Corners lie on whole pixels of their octave.
    const double half_px = 0.5 * static_cast<double>(OctaveScale(feature.feature.keypoint.octave)) + 1e-3;
    EXPECT_NEAR(static_cast<double>(feature.feature.keypoint.u_px), pixel.x(), half_px);
    EXPECT_NEAR(static_cast<double>(feature.feature.keypoint.v_px), pixel.y(), half_px);
    EXPECT_NEAR(static_cast<double>(feature.depth_m), p_camera.z(), 1e-5);
  }
}

TEST(FeatureCameraTest, OctavesRiseAsTheCameraComesNearer) {
  const auto camera = MakeCamera(MakeFeatureWorld(WallWorld()), NoNoise());
  const auto far = ByLandmark(camera->Observe(Look(0, 0), kSecond));
  // From 3 m to 3 / 1.44 m: two octaves.
  const auto near = ByLandmark(camera->Observe(Look(0, 3 - 3 / 1.44), kSecond));
  int num_common = 0, num_two_up = 0;
  for (const auto& [landmark, feature] : near) {
    const auto other = far.find(landmark);
    // Obliquely, the foreshortening changes as well.
    if (other == far.end() || std::hypot(feature.p_world.x(), feature.p_world.z() - 1.5) > 0.4) continue;
    ++num_common;
    num_two_up += feature.feature.keypoint.octave - other->second.feature.keypoint.octave == 2 ? 1 : 0;
  }
  ASSERT_GT(num_common, 50);
  EXPECT_GE(num_two_up, 0.9 * num_common);
}

TEST(FeatureCameraTest, WhatStandsBehindAWallIsNotSeen) {
  World world = WallWorld();
  // A narrow wall between camera and wall hides its middle; one behind the wall is hidden altogether.
  world.surroundings.quads.push_back(WallAt(2, 1, BrickTexture(2, 1, 3)));
  world.surroundings.quads.push_back(WallAt(4, 12, BrickTexture(3, 12, 3)));
  const auto camera = MakeCamera(MakeFeatureWorld(std::move(world)), NoNoise());
  const std::vector<ObservedFeature> features = camera->Observe(Look(0, 0), kSecond);
  int num_on_narrow = 0, num_on_wall = 0;
  for (const ObservedFeature& feature : features) {
    EXPECT_LT(feature.p_world.y(), 3.5) << "seen through the wall";
    if (feature.p_world.y() > 2.5) {
      ++num_on_wall;
      // The narrow wall at 2 m, half a metre to either side, shades three quarters of a metre on the wall at 3 m.
      EXPECT_GE(std::abs(feature.p_world.x()), 0.75 - 1e-6);
    } else {
      ++num_on_narrow;
    }
  }
  EXPECT_GT(num_on_narrow, 100);
  EXPECT_GT(num_on_wall, 100);
}

TEST(FeatureCameraTest, DescriptorsDriftApartWithTheAngleOfView) {
  const auto camera = MakeCamera(MakeFeatureWorld(WallWorld()));
  const auto walk = [](double angle) { return Look(-3 * std::sin(angle), 3 - 3 * std::cos(angle), -angle); };
  const auto straight = camera->Observe(walk(0), kSecond);
  size_t num_common = 0;
  const double again = MeanDistance(straight, camera->Observe(walk(0), 2 * kSecond), &num_common);
  EXPECT_GT(num_common, 400U);
  EXPECT_GE(again, 10);
  EXPECT_LE(again, 32);
  const double neighbour = MeanDistance(straight, camera->Observe(walk(0.1), 2 * kSecond), &num_common);
  EXPECT_GT(num_common, 200U);
  EXPECT_GE(neighbour, again - 1);
  EXPECT_LE(neighbour, 36);
  const double oblique =
      MeanDistance(straight, camera->Observe(walk(50 * std::numbers::pi / 180), 2 * kSecond), &num_common);
  EXPECT_GT(num_common, 20U);
  EXPECT_GE(oblique, 45);
  EXPECT_LE(oblique, 75);
}

TEST(FeatureCameraTest, DepthNoiseGrowsWithTheSquareOfDepth) {
  FeatureNoise noise = NoNoise();
  noise.depth_sigma_per_m = 0.0012;
  noise.max_depth_m = 6;
  const auto camera = MakeCamera(MakeFeatureWorld(WallWorld()), noise);
  for (const double distance_m : {2.0, 5.0}) {
    double sum_squares = 0;
    int count = 0;
    for (const ObservedFeature& feature : camera->Observe(Look(0, 3 - distance_m), kSecond)) {
      if (feature.depth_m <= 0) continue;
      sum_squares += std::pow(static_cast<double>(feature.depth_m) - distance_m, 2);
      ++count;
    }
    ASSERT_GT(count, 300);
    const double sigma_m = 0.0012 * distance_m * distance_m;
    EXPECT_NEAR(std::sqrt(sum_squares / count), sigma_m, 0.15 * sigma_m);
  }
  for (const ObservedFeature& feature : camera->Observe(Look(0, -3.5), kSecond)) EXPECT_EQ(feature.depth_m, 0);
}

TEST(FeatureCameraTest, StereoMeasuresDisparity) {
  FeatureNoise noise = NoNoise();
  noise.disparity_px = 0.35;
  const auto camera = MakeCamera(MakeFeatureWorld(WallWorld()), noise, 1, SensorKind::kStereo);
  double sum_squares = 0;
  int count = 0;
  for (const ObservedFeature& feature : camera->Observe(Look(0, 0), kSecond)) {
    if (feature.feature.keypoint.octave != 0) continue;
    sum_squares += std::pow(500 * 0.11 / static_cast<double>(feature.depth_m) - 500 * 0.11 / 3, 2);
    ++count;
  }
  ASSERT_GT(count, 100);
  EXPECT_NEAR(std::sqrt(sum_squares / count), 0.35, 0.07);
}

TEST(FeatureCameraTest, ClutterAndOutliersComeInTheirShares) {
  FeatureNoise noise = NoNoise();
  noise.clutter_ratio = 0.1;
  noise.depth_outlier_ratio = 0.05;
  const auto camera = MakeCamera(MakeFeatureWorld(WallWorld()), noise);
  int num_clutter = 0, num_outliers = 0, count = 0;
  for (int second = 1; second <= 5; ++second) {
    for (const ObservedFeature& feature : camera->Observe(Look(0, 0), second * kSecond)) {
      ++count;
      num_clutter += feature.landmark == 0 ? 1 : 0;
      num_outliers += feature.landmark != 0 && std::abs(feature.depth_m - 3.0F) > 0.02F ? 1 : 0;
    }
  }
  EXPECT_NEAR(num_clutter, 0.09 * count, 0.02 * count);
  EXPECT_NEAR(num_outliers, 0.045 * count, 0.015 * count);
}

/// A crate of 1 m with bricks on its sides.
WorldObject MakeCrate(uint32_t id, const std::shared_ptr<const Texture>& texture) {
  WorldObject crate;
  crate.id = id;
  crate.kind = "crate";
  crate.size_m = {1, 1, 1};
  crate.quads_object.push_back({.corner_world = {-0.5, -0.5, 0.5},
                                .edge_u_world = {1, 0, 0},
                                .edge_v_world = {0, 0, -1},
                                .texture = texture,
                                .object_id = id});
  return crate;
}

TEST(FeatureCameraTest, EqualObjectsCarryEqualLandmarks) {
  const auto texture = BrickTexture(5, 1, 1);
  World world;
  world.objects = {MakeCrate(1, texture), MakeCrate(2, texture)};
  world.objects[0].placements = {{.T_world_object = Pose3(Eigen::Quaterniond::Identity(), {-0.8, 2.5, 1.5})}};
  world.objects[1].placements = {{.T_world_object = Pose3(Eigen::Quaterniond::Identity(), {0.8, 2.5, 1.5})}};
  const auto camera = MakeCamera(MakeFeatureWorld(std::move(world)), NoNoise());
  std::map<uint32_t, std::map<std::pair<int64_t, int64_t>, std::multiset<std::string>>> looks;
  for (const ObservedFeature& feature : camera->Observe(Look(0, 0), kSecond)) {
    const Eigen::Vector3d p_object = feature.p_world - Eigen::Vector3d(feature.object_id == 1 ? -0.8 : 0.8, 2.5, 1.5);
    looks[feature.object_id][{std::llround(p_object.x() * 1e5), std::llround(p_object.z() * 1e5)}].insert(
        std::string(feature.feature.descriptor.Bytes()));
  }
  ASSERT_EQ(looks.size(), 2U);
  ASSERT_GT(looks[1].size(), 100U);
  int num_common = 0;
  for (const auto& [place, descriptors] : looks[1]) {
    const auto other = looks[2].find(place);
    if (other == looks[2].end()) continue;
    ++num_common;
    const bool share_a_look = std::any_of(descriptors.begin(), descriptors.end(),
                                          [&](const std::string& look) { return other->second.contains(look); });
    EXPECT_TRUE(share_a_look);
  }
  EXPECT_GE(num_common, 0.5 * static_cast<double>(looks[1].size()));
}

TEST(FeatureCameraTest, LandmarksGoWithTheirObject) {
  World world = WallWorld();
  world.objects = {MakeCrate(7, BrickTexture(5, 1, 1))};
  const Pose3 before(Eigen::Quaterniond::Identity(), {-0.8, 2.5, 1.5});
  const Pose3 after(Eigen::Quaterniond::Identity(), {0.8, 2.5, 1.5});
  world.objects[0].placements = {{.T_world_object = before},
                                 {.from_ns = 10 * kSecond, .T_world_object = after},
                                 {.from_ns = 20 * kSecond, .T_world_object = std::nullopt}};
  const auto camera = MakeCamera(MakeFeatureWorld(std::move(world)), NoNoise());
  const auto on_crate = [&](int64_t stamp_ns) {
    std::map<uint64_t, Eigen::Vector3d> landmarks;
    for (const ObservedFeature& feature : camera->Observe(Look(0, 0), stamp_ns)) {
      if (feature.object_id == 7) landmarks[feature.landmark] = feature.p_world;
    }
    return landmarks;
  };
  const auto there = on_crate(9 * kSecond), moved = on_crate(10 * kSecond);
  ASSERT_GT(there.size(), 50U);
  size_t num_common = 0;
  for (const auto& [landmark, p_world] : moved) {
    const auto other = there.find(landmark);
    if (other == there.end()) continue;
    ++num_common;
    EXPECT_NEAR((p_world - other->second - Eigen::Vector3d(1.6, 0, 0)).norm(), 0, 1e-9);
  }
  EXPECT_GE(num_common, there.size() / 2);
  EXPECT_TRUE(on_crate(20 * kSecond).empty());
}

TEST(FeatureCameraTest, RefusesNoiseOutOfRange) {
  const auto world = MakeFeatureWorld(WallWorld());
  FeatureNoise noise;
  noise.clutter_ratio = 1.5;
  const Status ratio = FeatureCamera::Create(world, TestRig(), noise, 1).status();
  EXPECT_EQ(ratio.code(), absl::StatusCode::kInvalidArgument);
  EXPECT_THAT(std::string(ratio.message()), HasSubstr("clutter_ratio"));
  noise = {};
  noise.pixel_px = -1;
  EXPECT_THAT(std::string(FeatureCamera::Create(world, TestRig(), noise, 1).status().message()), HasSubstr("pixel_px"));
}

}  // namespace
}  // namespace mapp::sim
