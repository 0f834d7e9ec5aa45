#include "sim/texture.h"

#include "mapp/base/rng.h"

#include <gtest/gtest.h>

namespace mapp::sim {
namespace {

/// The second of four samples of which the others lie elsewhere.
float SampleOne(const Texture& texture, float u, float v, float level, Texture::Beyond beyond) {
  return texture.SampleLevel({0.9F, u, 0.1F, 0.4F}, {0.2F, v, 0.8F, 0.3F}, level, beyond)[1];
}

TEST(TextureTest, TexelCentersKeepTheirLevel) {
  GrayImage image(4, 2);
  for (size_t i = 0; i < image.pixels.size(); ++i) image.pixels[i] = static_cast<uint8_t>(30 * i);
  const Texture texture(image);
  for (int y = 0; y < 2; ++y) {
    for (int x = 0; x < 4; ++x) {
      const float u = (static_cast<float>(x) + 0.5F) / 4;
      const float v = (static_cast<float>(y) + 0.5F) / 2;
      EXPECT_NEAR(texture.Sample(u, v, 1.0F), image.at(x, y), 1e-3);
    }
  }
}

TEST(TextureTest, BlendsBetweenTexels) {
  GrayImage image(2, 1);
  image.at(1, 0) = 100;
  EXPECT_NEAR(Texture(image).Sample(0.5F, 0.5F, 1.0F), 50, 1e-3);
}

TEST(TextureTest, WideFootprintsSeeTheMean) {
  GrayImage image(64, 64);
  Rng rng(3);
  double sum = 0;
  for (uint8_t& level : image.pixels) {
    level = static_cast<uint8_t>(rng.Below(256));
    sum += level;
  }
  const Texture texture(image);
  EXPECT_NEAR(texture.Sample(0.3F, 0.8F, 64.0F), sum / 4096, 3.0);  // each level rounds
  EXPECT_NEAR(texture.Sample(0.3F, 0.8F, 1e6F), sum / 4096, 3.0);
}

TEST(TextureTest, ColumnsAndRowsOfOneTexelWork) {
  EXPECT_NEAR(Texture(GrayImage(1, 5, 77)).Sample(0.9F, 0.9F, 3.0F), 77, 1e-3);
}

TEST(TextureTest, RepeatsSeamlessly) {
  GrayImage image(5, 3);
  for (size_t i = 0; i < image.pixels.size(); ++i) image.pixels[i] = static_cast<uint8_t>(17 * i);
  const Texture texture(image);
  const auto repeated = [&](float u, float v) { return SampleOne(texture, u, v, 0, Texture::Beyond::kRepeat); };
  EXPECT_NEAR(repeated(0.1F, 0.5F), image.at(0, 1), 1e-3) << "a texel's centre";
  EXPECT_NEAR(repeated(-1.9F, 3.5F), image.at(0, 1), 1e-3);
  EXPECT_NEAR(repeated(0.0F, 0.5F), 0.5 * (image.at(4, 1) + image.at(0, 1)), 1e-3) << "across the border";
  EXPECT_NEAR(repeated(2.0F, 0.5F), 0.5 * (image.at(4, 1) + image.at(0, 1)), 1e-3);
  EXPECT_NEAR(repeated(0.3F, 1.0F), 0.5 * (image.at(1, 2) + image.at(1, 0)), 1e-3);
  EXPECT_NEAR(SampleOne(texture, -0.5F, 0.5F, 0, Texture::Beyond::kClamp), image.at(0, 1), 1e-3);
}

TEST(TextureTest, LevelsOutOfRangeAreTheNearestOne) {
  GrayImage image(2, 2);
  image.pixels = {0, 100, 200, 100};
  const Texture texture(image);
  EXPECT_NEAR(SampleOne(texture, 0.25F, 0.25F, -3, Texture::Beyond::kRepeat), 0, 1e-3);
  EXPECT_NEAR(SampleOne(texture, 0.25F, 0.25F, 9, Texture::Beyond::kRepeat), 100, 1e-3);
}

}  // namespace
}  // namespace mapp::sim
