#include "sim/sensor_noise.h"

#include <gtest/gtest.h>

#include <cmath>
#include <memory>
#include <vector>

namespace mapp::sim {
namespace {

RenderedFrame Plain(uint8_t level, float depth_m) {
  return {GrayImage(320, 240, level), DepthImage(320, 240, depth_m)};
}

template <typename T>
std::pair<double, double> MeanAndDeviation(const Image<T>& image) {
  double sum = 0;
  double sum_squares = 0;
  for (const T value : image.pixels) {
    sum += value;
    sum_squares += double(value) * double(value);
  }
  const auto count = static_cast<double>(image.pixels.size());
  const double mean = sum / count;
  return {mean, std::sqrt(sum_squares / count - mean * mean)};
}

TEST(SensorNoiseTest, HasTheStatedSpread) {
  RenderedFrame frame = Plain(100, 3.0F);
  AddSensorNoise({.gray_sigma = 2.0, .depth_sigma_per_m = 0.0012}, 5, frame);
  const auto [gray_mean, gray_deviation] = MeanAndDeviation(frame.gray);
  EXPECT_NEAR(gray_mean, 100, 0.1);
  EXPECT_NEAR(gray_deviation, 2.0, 0.15);  // rounding to levels adds 1/12 to the variance
  const auto [depth_mean, depth_deviation] = MeanAndDeviation(frame.depth_m);
  EXPECT_NEAR(depth_mean, 3.0, 0.001);
  EXPECT_NEAR(depth_deviation, 0.0012 * 9, 0.0006);
}

TEST(SensorNoiseTest, IsTheSameForTheSameSeedOnly) {
  RenderedFrame first = Plain(100, 2.0F);
  RenderedFrame again = Plain(100, 2.0F);
  RenderedFrame other = Plain(100, 2.0F);
  AddSensorNoise({}, 5, first);
  AddSensorNoise({}, 5, again);
  AddSensorNoise({}, 6, other);
  EXPECT_EQ(first.gray.pixels, again.gray.pixels);
  EXPECT_EQ(first.depth_m.pixels, again.depth_m.pixels);
  EXPECT_NE(first.gray.pixels, other.gray.pixels);
}

TEST(SensorNoiseTest, NoReadingStaysNoneAndFarOnesAreDropped) {
  RenderedFrame frame = Plain(100, 0.0F);
  frame.depth_m.at(0, 0) = 9.0F;
  AddSensorNoise({.max_depth_m = 8.0}, 5, frame);
  for (const float depth_m : frame.depth_m.pixels) ASSERT_EQ(depth_m, 0);
}

TEST(SensorNoiseTest, BlackAndWhiteDoNotWrapAround) {
  RenderedFrame black = Plain(0, 1.0F);
  RenderedFrame white = Plain(255, 1.0F);
  AddSensorNoise({}, 5, black);
  AddSensorNoise({}, 5, white);
  for (const uint8_t level : black.gray.pixels) ASSERT_LT(level, 20);
  for (const uint8_t level : white.gray.pixels) ASSERT_GT(level, 235);
}

TEST(ExposureTest, GainMultipliesAndSaturates) {
  RenderedFrame frame = Plain(100, 2.0F);
  frame.gray.at(0, 0) = 200;
  frame.color = ColorImage(1, 1, {10, 20, 250});
  ApplyGain(1.5, frame);
  EXPECT_EQ(frame.gray.at(1, 0), 150);
  EXPECT_EQ(frame.gray.at(0, 0), 255);
  EXPECT_EQ(frame.color.at(0, 0), (std::array<uint8_t, 3>{15, 30, 255}));
  EXPECT_EQ(frame.depth_m.at(0, 0), 2.0F);
}

TEST(MotionBlurTest, AveragesLevelsOverThePosesAndKeepsTheMiddleDepth) {
  // The right half of a wall is white; the camera turns past its edge.
  auto scene = std::make_shared<Scene>();
  const auto add = [&](double x_m, uint8_t level) {
    scene->quads.push_back(
        Quad{{x_m, -50, 4}, {50, 0, 0}, {0, 100, 0}, std::make_shared<const Texture>(GrayImage(4, 4, level))});
  };
  add(-50, 40);
  add(0, 240);
  const auto renderer = MakeEmbreeRenderer(scene, {.num_threads = 1, .with_color = true});
  const Camera camera{PinholeCamera{100, 100, 39.5, 29.5}, 80, 60};
  std::vector<Pose3> poses;
  for (const double x_m : {-0.4, -0.2, 0.0, 0.2})
    poses.emplace_back(Eigen::Quaterniond::Identity(), Eigen::Vector3d(x_m, 0, 0.5 * x_m));
  const auto frame = RenderWithMotionBlur(*renderer, camera, poses, {});
  ASSERT_TRUE(frame.ok()) << frame.status();
  EXPECT_EQ(frame->gray.at(5, 30), 40);
  EXPECT_EQ(frame->gray.at(75, 30), 240);
  EXPECT_EQ(frame->gray.at(42, 30), 140) << "white in the two poses furthest right";
  EXPECT_EQ(frame->color.at(42, 30)[1], 140);
  EXPECT_NEAR(frame->depth_m.at(42, 30), 4, 1e-5);
  EXPECT_EQ(RenderWithMotionBlur(*renderer, camera, {}, {}).status().code(), absl::StatusCode::kInvalidArgument);
}

}  // namespace
}  // namespace mapp::sim
