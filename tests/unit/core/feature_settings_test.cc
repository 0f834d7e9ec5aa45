#include "mapp/feature/feature_settings.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <limits>

namespace mapp {
namespace {

using ::testing::StartsWith;

TEST(FeatureSettingsTest, DefaultsAreValidAndNameThePyramidOfTheExtractor) {
  const FeatureSettings settings;
  EXPECT_TRUE(settings.Validate().ok()) << settings.Validate();
  EXPECT_EQ(settings.scale_factor, kPyramidScale);
  EXPECT_EQ(settings.num_levels, kPyramidLevels);
  EXPECT_FALSE(FirstDifference(settings, settings).has_value());
}

struct BadSettings {
  FeatureSettings settings;
  std::string field;
};

class BadFeatureSettingsTest : public testing::TestWithParam<BadSettings> {};
INSTANTIATE_TEST_SUITE_P(
    Fields, BadFeatureSettingsTest,
    testing::Values(BadSettings{{.descriptor_kind = ""}, "descriptor_kind"},
                    BadSettings{{.descriptor_kind = "ORB 256"}, "descriptor_kind"},
                    BadSettings{{.descriptor_kind = "ORB\n"}, "descriptor_kind"},
                    BadSettings{{.descriptor_kind = std::string(33, 'x')}, "descriptor_kind"},
                    BadSettings{{.scale_factor = std::numeric_limits<float>::quiet_NaN()}, "scale_factor"},
                    BadSettings{{.scale_factor = std::numeric_limits<float>::infinity()}, "scale_factor"},
                    BadSettings{{.scale_factor = 1}, "scale_factor"},
                    BadSettings{{.scale_factor = 4.1F}, "scale_factor"}, BadSettings{{.num_levels = 0}, "num_levels"},
                    BadSettings{{.num_levels = -8}, "num_levels"},
                    BadSettings{{.num_levels = kPyramidLevels + 1}, "num_levels"},
                    BadSettings{{.patch_size_px = 2}, "patch_size_px"},
                    BadSettings{{.patch_size_px = 256}, "patch_size_px"}));

TEST_P(BadFeatureSettingsTest, AreRefusedByName) {
  const Status status = GetParam().settings.Validate();
  EXPECT_EQ(status.code(), absl::StatusCode::kInvalidArgument);
  EXPECT_THAT(std::string(status.message()), StartsWith("feature_settings." + GetParam().field + ": "));
}

TEST(FeatureSettingsTest, FindsTheFieldThatDiffersAndBothValues) {
  const FeatureSettings ours;
  const auto expect = [&](const FeatureSettings& theirs, const std::string& field, const std::string& a,
                          const std::string& b) {
    const std::optional<FeatureSettingsDifference> difference = FirstDifference(ours, theirs);
    ASSERT_TRUE(difference.has_value()) << field;
    EXPECT_EQ(difference->field, field);
    EXPECT_EQ(difference->a, a);
    EXPECT_EQ(difference->b, b);
  };
  expect({.descriptor_kind = "AKAZE-256"}, "descriptor_kind", "ORB-256", "AKAZE-256");
  expect({.scale_factor = 1.5F}, "scale_factor", "1.2", "1.5");
  expect({.num_levels = 4}, "num_levels", "8", "4");
  expect({.patch_size_px = 41}, "patch_size_px", "31", "41");
}

TEST(FeatureSettingsTest, ForgivesTheRoundingOfAScaleFactor) {
  const FeatureSettings ours;
  EXPECT_FALSE(FirstDifference(ours, {.scale_factor = 1.20001F}).has_value());
  EXPECT_TRUE(FirstDifference(ours, {.scale_factor = 1.201F}).has_value());
}

}  // namespace
}  // namespace mapp
