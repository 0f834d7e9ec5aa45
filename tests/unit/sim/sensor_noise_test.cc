#include "sim/sensor_noise.h"

#include <gtest/gtest.h>

#include <cmath>

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

}  // namespace
}  // namespace mapp::sim
