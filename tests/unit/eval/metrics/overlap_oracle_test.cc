#include "eval/metrics/overlap_oracle.h"

#include "mapp/base/rng.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <limits>

namespace mapp {
namespace {

Camera TestCamera() {
  Camera camera;
  camera.projection = PinholeCamera{500, 500, 319.5, 239.5};
  camera.width_px = 640;
  camera.height_px = 480;
  return camera;
}

Pose3 FarPose() { return Pose3(ExpSo3({0.2, 1.1, -0.4}), {40, -25, 3}); }

OrbDescriptor RandomDescriptor(Rng& rng) {
  OrbDescriptor descriptor;
  for (uint64_t& word : descriptor.words) word = rng.Next();
  return descriptor;
}

OrbDescriptor WithBitsFlipped(OrbDescriptor descriptor, int num_bits) {
  for (int i = 0; i < num_bits; ++i) descriptor.words[static_cast<size_t>(i % 4)] ^= uint64_t{1} << (i / 4);
  return descriptor;
}

/// A view of `count` points between 1 and 20 m, and the map that holds exactly these, all seen from the same place.
struct Setting {
  Pose3 T_map_camera = FarPose();
  std::vector<Eigen::Vector3d> own;
  std::vector<Feature> features;
  std::vector<SeenPoint> points;

  explicit Setting(size_t count) {
    Rng rng(1);
    for (size_t i = 0; i < count; ++i) {
      const Eigen::Vector2d pixel(rng.Uniform(0, 639), rng.Uniform(0, 479));
      own.push_back(rng.Uniform(1, 20) * TestCamera().Unproject(pixel));
      Feature feature;
      feature.keypoint.u_px = static_cast<float>(pixel.x());
      feature.keypoint.v_px = static_cast<float>(pixel.y());
      feature.descriptor = RandomDescriptor(rng);
      features.push_back(feature);
      points.push_back({T_map_camera * own.back(), feature.descriptor, {T_map_camera.translation()}});
    }
  }
  size_t NumKnown(const OracleRule& rule = {}) const {
    const auto known = Oracle(rule)->KnownByGeometry(T_map_camera, own);
    return static_cast<size_t>(std::ranges::count(known, true));
  }
  size_t NumMatched(const OracleRule& rule = {}) const {
    const auto known = Oracle(rule)->KnownByDescriptor(T_map_camera, TestCamera(), features);
    return static_cast<size_t>(std::ranges::count(known, true));
  }
  std::unique_ptr<OverlapOracle> Oracle(const OracleRule& rule = {}) const {
    auto oracle = OverlapOracle::Create(points, rule);
    EXPECT_TRUE(oracle.ok()) << oracle.status();
    return std::move(oracle).value();
  }
};

TEST(OverlapOracleTest, AMapThatHoldsTheViewKnowsAllOfIt) {
  const Setting setting(300);
  EXPECT_EQ(setting.NumKnown(), 300);
  EXPECT_EQ(setting.NumMatched(), 300);
}

TEST(OverlapOracleTest, AnEmptyMapKnowsNothing) {
  Setting setting(20);
  setting.points.clear();
  EXPECT_EQ(setting.NumKnown(), 0);
  EXPECT_EQ(setting.NumMatched(), 0);
}

TEST(OverlapOracleTest, DroppedPointsAreNotKnown) {
  // Points so sparse that none stands in for another.
  Setting setting(40);
  const OracleRule strict{.min_reach_m = 0.01, .reach_ratio = 0.001, .match_px = 3};
  setting.points.resize(25);
  const auto oracle = setting.Oracle(strict);
  const auto by_geometry = oracle->KnownByGeometry(setting.T_map_camera, setting.own);
  const auto by_descriptor = oracle->KnownByDescriptor(setting.T_map_camera, TestCamera(), setting.features);
  for (size_t i = 0; i < 40; ++i) {
    EXPECT_EQ(by_geometry[i], i < 25) << i;
    EXPECT_EQ(by_descriptor[i], i < 25) << i;
  }
}

TEST(OverlapOracleTest, ReachesFiveCentimetresOrFivePercentOfDepth) {
  for (const double depth_m : {0.5, 0.9, 1.5, 10.0}) {
    const double reach_m = std::max(0.05, 0.05 * depth_m);
    for (const double share : {0.95, 1.05}) {
      Setting setting(0);
      setting.own = {{0.1, 0.2, depth_m}};
      const Eigen::Vector3d moved = setting.own[0] + Eigen::Vector3d(0, share * reach_m, 0);
      setting.points = {{setting.T_map_camera * moved, {}, {setting.T_map_camera.translation()}}};
      EXPECT_EQ(setting.NumKnown(), share < 1 ? 1 : 0) << depth_m << " m, " << share;
    }
  }
}

TEST(OverlapOracleTest, APointSeenFromElsewhereIsNotKnown) {
  for (const double angle_deg : {0.0, 30.0, 49.0, 51.0, 90.0, 180.0}) {
    Setting setting(0);
    setting.own = {{0, 0, 4}};
    const Eigen::Vector3d p_map = setting.T_map_camera * setting.own[0];
    // Observers around the point, 7 m away; one of them alone decides.
    const auto observer_at = [&](double degrees) {
      const double angle = degrees * std::numbers::pi / 180;
      return Eigen::Vector3d(setting.T_map_camera * Eigen::Vector3d(7 * std::sin(angle), 0, 4 - 7 * std::cos(angle)));
    };
    setting.points = {{p_map, {}, {observer_at(170), observer_at(angle_deg)}}};
    EXPECT_EQ(setting.NumKnown(), angle_deg < 50 ? 1 : 0) << angle_deg;
  }
}

TEST(OverlapOracleTest, PosesPerturbedBeyondTheReachKnowLess) {
  const Setting setting(300);
  const auto oracle = setting.Oracle();
  size_t previous = 301;
  for (const double shift_m : {0.0, 0.2, 0.5, 2.0}) {
    const Pose3 perturbed = setting.T_map_camera * Pose3(Eigen::Quaterniond::Identity(), {shift_m, 0, 0});
    const auto known = oracle->KnownByGeometry(perturbed, setting.own);
    size_t in_reach = 0;  // every point that its own counterpart still reaches, and no fewer
    for (const Eigen::Vector3d& own : setting.own) in_reach += shift_m < std::max(0.05, 0.05 * own.z()) ? 1 : 0;
    const auto num_known = static_cast<size_t>(std::ranges::count(known, true));
    EXPECT_GE(num_known, in_reach);
    EXPECT_LT(num_known, previous);
    previous = num_known;
  }
  EXPECT_LT(previous, 60);
}

TEST(OverlapOracleTest, AgreesWithASearchOfEveryPoint) {
  Rng rng(17);
  Setting setting(400);
  for (SeenPoint& point : setting.points) {
    point.p_map += 0.4 * Eigen::Vector3d(rng.Normal(), rng.Normal(), rng.Normal());
    point.observers_map = {point.p_map + 5 * Eigen::Vector3d(rng.Normal(), rng.Normal(), rng.Normal())};
  }
  const auto known = setting.Oracle()->KnownByGeometry(setting.T_map_camera, setting.own);
  size_t num_known = 0;
  for (size_t i = 0; i < setting.own.size(); ++i) {
    const Eigen::Vector3d own_map = setting.T_map_camera * setting.own[i];
    const bool expected = std::ranges::any_of(setting.points, [&](const SeenPoint& point) {
      const Eigen::Vector3d ray = point.p_map - setting.T_map_camera.translation();
      const Eigen::Vector3d seen = point.p_map - point.observers_map[0];
      return (point.p_map - own_map).norm() < std::max(0.05, 0.05 * setting.own[i].z()) &&
             std::acos(ray.normalized().dot(seen.normalized())) < 50 * std::numbers::pi / 180;
    });
    EXPECT_EQ(known[i], expected) << i;
    num_known += expected ? 1 : 0;
  }
  EXPECT_GT(num_known, 20);
  EXPECT_LT(num_known, 380);
}

TEST(OverlapOracleTest, DescriptorsMatchUpToFiftyBits) {
  Setting setting(100);
  for (const auto& [num_bits, expected] : {std::pair<int, size_t>{0, 100}, {50, 100}, {51, 0}, {128, 0}}) {
    Setting changed = setting;
    for (Feature& feature : changed.features) feature.descriptor = WithBitsFlipped(feature.descriptor, num_bits);
    EXPECT_EQ(changed.NumMatched(), expected) << num_bits;
  }
}

TEST(OverlapOracleTest, DescriptorsMatchWithinFifteenPixels) {
  Setting setting(100);
  for (const auto& [shift_px, expected] : {std::pair<float, size_t>{14.5F, 100}, {15.5F, 0}}) {
    Setting shifted = setting;
    for (Feature& feature : shifted.features) feature.keypoint.u_px += shift_px;
    EXPECT_EQ(shifted.NumMatched(), expected) << shift_px;
  }
}

TEST(OverlapOracleTest, WhatIsBehindTheCameraDoesNotMatch) {
  Setting setting(50);
  for (size_t i = 0; i < 50; ++i) setting.points[i].p_map = setting.T_map_camera * (-setting.own[i]);
  EXPECT_EQ(setting.NumMatched(), 0);
}

TEST(OverlapOracleTest, RefusesPointsThatAreNotFinite) {
  SeenPoint broken{Eigen::Vector3d(0, std::numeric_limits<double>::quiet_NaN(), 0), {}, {}};
  EXPECT_EQ(OverlapOracle::Create({broken}).status().code(), absl::StatusCode::kInvalidArgument);
}

}  // namespace
}  // namespace mapp
