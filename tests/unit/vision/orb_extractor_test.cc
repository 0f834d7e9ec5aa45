#include "vision/orb_extractor.h"

#include "tests/unit/vision/synthetic.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <map>
#include <numbers>
#include <string>

namespace mapp {
namespace {

using test::TexturedImage;
using ::testing::StartsWith;

std::unique_ptr<OrbExtractor> MakeExtractor(const OrbExtractorOptions& options = {}) {
  auto extractor = OrbExtractor::Create(options);
  EXPECT_TRUE(extractor.ok()) << extractor.status();
  return std::move(extractor).value();
}

std::vector<Feature> Extract(OrbExtractor& extractor, const GrayImage& image) {
  auto features = extractor.Extract(image.View());
  EXPECT_TRUE(features.ok()) << features.status();
  return std::move(features).value();
}

struct BadOptions {
  std::string name;
  OrbExtractorOptions options;
  std::string field;
};

class OrbExtractorOptionsTest : public ::testing::TestWithParam<BadOptions> {};

TEST_P(OrbExtractorOptionsTest, NamesTheFieldOutOfRange) {
  const auto extractor = OrbExtractor::Create(GetParam().options);
  ASSERT_EQ(extractor.status().code(), absl::StatusCode::kInvalidArgument);
  EXPECT_THAT(std::string(extractor.status().message()), StartsWith(GetParam().field + ":"));
}

INSTANTIATE_TEST_SUITE_P(
    All, OrbExtractorOptionsTest,
    ::testing::Values(BadOptions{"TooFew", {.num_features = 49}, "num_features"},
                      BadOptions{"TooMany", {.num_features = kMaxFeatures + 1}, "num_features"},
                      BadOptions{"ZeroThreshold", {.min_fast_threshold = 0}, "min_fast_threshold"},
                      BadOptions{"Swapped", {.fast_threshold = 7, .min_fast_threshold = 20}, "min_fast_threshold"},
                      BadOptions{"Cell", {.cell_px = 4}, "cell_px"}),
    [](const auto& case_info) { return case_info.param.name; });

TEST(OrbExtractorTest, TellsTheSettingsThatMapsHaveByDefault) {
  const FeatureSettings settings = MakeExtractor({.num_features = 200, .fast_threshold = 40})->feature_settings();
  EXPECT_EQ(settings.descriptor_kind, "ORB-256");
  EXPECT_EQ(settings.patch_size_px, 31);
  EXPECT_FALSE(FirstDifference(settings, FeatureSettings()).has_value());
}

TEST(OrbExtractorTest, RejectsSmallAndEmptyImages) {
  const auto extractor = MakeExtractor();
  EXPECT_EQ(extractor->Extract({}).status().code(), absl::StatusCode::kInvalidArgument);
  const GrayImage narrow(63, 480);
  EXPECT_EQ(extractor->Extract(narrow.View()).status().code(), absl::StatusCode::kInvalidArgument);
}

TEST(OrbExtractorTest, FindsNothingOnAPlainWall) {
  const auto extractor = MakeExtractor();
  EXPECT_TRUE(Extract(*extractor, GrayImage(640, 480, 128)).empty());
}

TEST(OrbExtractorTest, AcceptsTheSmallestImage) {
  const auto extractor = MakeExtractor();
  EXPECT_FALSE(Extract(*extractor, TexturedImage(64, 64, 9)).empty());
}

TEST(OrbExtractorTest, FillsTheQuotaWithFeaturesInsideTheImage) {
  const auto extractor = MakeExtractor();
  const std::vector<Feature> features = Extract(*extractor, TexturedImage(640, 480, 14));
  EXPECT_GT(features.size(), 950U);
  EXPECT_LE(features.size(), static_cast<size_t>(kMaxFeatures));
  std::map<int, int> by_octave;
  for (const Feature& feature : features) {
    const Keypoint& keypoint = feature.keypoint;
    EXPECT_GE(keypoint.u_px, 0);
    EXPECT_LT(keypoint.u_px, 640);
    EXPECT_GE(keypoint.v_px, 0);
    EXPECT_LT(keypoint.v_px, 480);
    EXPECT_GE(keypoint.angle, 0);
    EXPECT_LT(keypoint.angle, 2 * std::numbers::pi_v<float>);
    ++by_octave[keypoint.octave];
  }
  EXPECT_EQ(by_octave.size(), static_cast<size_t>(kPyramidLevels));
}

TEST(OrbExtractorTest, IsDeterministicAndKeepsNoStateBetweenImages) {
  const GrayImage image = TexturedImage(640, 480, 14);
  const auto extractor = MakeExtractor();
  const std::vector<Feature> first = Extract(*extractor, image);
  Extract(*extractor, TexturedImage(320, 240, 11));
  const std::vector<Feature> second = Extract(*extractor, image);
  ASSERT_EQ(first.size(), second.size());
  for (size_t i = 0; i < first.size(); ++i) {
    EXPECT_EQ(first[i].keypoint.u_px, second[i].keypoint.u_px);
    EXPECT_EQ(first[i].keypoint.angle, second[i].keypoint.angle);
    EXPECT_EQ(first[i].descriptor, second[i].descriptor);
  }
}

TEST(OrbExtractorTest, ReadsImagesWithPaddedRows) {
  const GrayImage wide = TexturedImage(700, 480, 14);
  GrayImage cropped(640, 480);
  for (int y = 0; y < 480; ++y) {
    for (int x = 0; x < 640; ++x) cropped.at(x, y) = wide.at(x, y);
  }
  const auto extractor = MakeExtractor();
  const std::vector<Feature> expected = Extract(*extractor, cropped);
  const auto padded = extractor->Extract({wide.pixels.data(), 640, 480, 700});
  ASSERT_TRUE(padded.ok());
  ASSERT_EQ(padded->size(), expected.size());
  for (size_t i = 0; i < expected.size(); ++i) EXPECT_EQ((*padded)[i].descriptor, expected[i].descriptor);
}

TEST(OrbExtractorTest, FindsCornersInTheDarkByTheSecondThreshold) {
  GrayImage image = TexturedImage(640, 480, 24);
  for (uint8_t& pixel : image.pixels) pixel = static_cast<uint8_t>(100 + pixel / 12);
  const auto faint = MakeExtractor();
  const auto strict = MakeExtractor({.min_fast_threshold = 20});
  EXPECT_GT(Extract(*faint, image).size(), 50U);
  EXPECT_LT(Extract(*strict, image).size(), 10U);
}

/// A bright square in the middle of the image: by symmetry its corners average to the middle on every level, unless
/// positions are scaled about the wrong point (half a coarse pixel is 1.8 fine ones at the top of the pyramid).
TEST(OrbExtractorTest, ScalesPositionsAboutPixelCenters) {
  GrayImage image(640, 480, 40);
  for (int y = 140; y < 340; ++y) {
    for (int x = 220; x < 420; ++x) image.at(x, y) = 200;
  }
  const auto extractor = MakeExtractor();
  struct Extent {
    float left = 1e9F, right = -1e9F, top = 1e9F, bottom = -1e9F;
  };
  std::map<int, Extent> extents;
  for (const Feature& feature : Extract(*extractor, image)) {
    Extent& extent = extents[feature.keypoint.octave];
    extent.left = std::min(extent.left, feature.keypoint.u_px);
    extent.right = std::max(extent.right, feature.keypoint.u_px);
    extent.top = std::min(extent.top, feature.keypoint.v_px);
    extent.bottom = std::max(extent.bottom, feature.keypoint.v_px);
  }
  ASSERT_GE(extents.size(), 6U);
  for (const auto& [octave, extent] : extents) {
    // The middle between pixels 0 and 639, up to half a pixel of the level.
    const float tolerance_px = 0.3F * OctaveScale(octave);
    EXPECT_NEAR((extent.left + extent.right) / 2, 319.5F, tolerance_px) << "octave " << octave;
    EXPECT_NEAR((extent.top + extent.bottom) / 2, 239.5F, tolerance_px) << "octave " << octave;
  }
}

/// Turning the image by 90 degrees turns positions and angles and leaves descriptors nearly as they were.
TEST(OrbExtractorTest, DescribesATurnedImageAlike) {
  const GrayImage image = TexturedImage(480, 480, 14);
  GrayImage turned(480, 480);  // clockwise: (x, y) goes to (479 - y, x)
  for (int y = 0; y < 480; ++y) {
    for (int x = 0; x < 480; ++x) turned.at(479 - y, x) = image.at(x, y);
  }
  const auto extractor = MakeExtractor();
  const std::vector<Feature> upright = Extract(*extractor, image);
  const std::vector<Feature> rotated = Extract(*extractor, turned);
  int num_found = 0;
  int num_alike = 0;
  for (const Feature& a : upright) {
    for (const Feature& b : rotated) {
      if (a.keypoint.octave != b.keypoint.octave) continue;
      if (std::hypot(479 - a.keypoint.v_px - b.keypoint.u_px, a.keypoint.u_px - b.keypoint.v_px) > 0.1F) continue;
      ++num_found;
      const double turn = b.keypoint.angle - a.keypoint.angle - std::numbers::pi / 2;
      EXPECT_NEAR(std::remainder(turn, 2 * std::numbers::pi), 0.0, 0.05);
      if (HammingDistance(a.descriptor, b.descriptor) <= 40) ++num_alike;
    }
  }
  EXPECT_GT(num_found, 500);
  EXPECT_GT(num_alike, 0.95 * num_found);
}

}  // namespace
}  // namespace mapp
