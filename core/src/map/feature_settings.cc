#include "mapp/feature/feature_settings.h"

#include <fmt/format.h>

#include <cmath>
#include <string_view>

namespace mapp {
namespace {

constexpr size_t kMaxDescriptorName = 32;
constexpr float kMinScaleFactor = 1.01F;
constexpr float kMaxScaleFactor = 4;
constexpr int kMinPatchSize = 3;
constexpr int kMaxPatchSize = 255;
/// Forgives how devices compute a scale factor; over 8 levels it is less than a thousandth.
constexpr float kScaleFactorTolerance = 1e-4F;

/// Such a name may go into messages as it is.
bool IsDescriptorName(std::string_view name) {
  constexpr std::string_view kAllowed = "ABCDEFGHIJKLMNOPQRSTUVWXYZabcdefghijklmnopqrstuvwxyz0123456789._+-";
  return !name.empty() && name.size() <= kMaxDescriptorName && name.find_first_not_of(kAllowed) == name.npos;
}

Status OutOfRange(std::string_view field, auto low, auto high, auto value) {
  return absl::InvalidArgumentError(
      fmt::format("feature_settings.{}: must be in [{}, {}], got {}", field, low, high, value));
}

}  // namespace

Status FeatureSettings::Validate() const {
  if (!IsDescriptorName(descriptor_kind)) {
    return absl::InvalidArgumentError(
        fmt::format("feature_settings.descriptor_kind: must be 1 to {} of A-Z a-z 0-9 . _ + -", kMaxDescriptorName));
  }
  if (!(scale_factor >= kMinScaleFactor && scale_factor <= kMaxScaleFactor)) {
    return OutOfRange("scale_factor", kMinScaleFactor, kMaxScaleFactor, scale_factor);
  }
  if (num_levels < 1 || num_levels > kPyramidLevels) return OutOfRange("num_levels", 1, kPyramidLevels, num_levels);
  if (patch_size_px < kMinPatchSize || patch_size_px > kMaxPatchSize) {
    return OutOfRange("patch_size_px", kMinPatchSize, kMaxPatchSize, patch_size_px);
  }
  return absl::OkStatus();
}

std::optional<FeatureSettingsDifference> FirstDifference(const FeatureSettings& a, const FeatureSettings& b) {
  const auto differ = [](const char* field, const auto& of_a, const auto& of_b) {
    return FeatureSettingsDifference{field, fmt::format("{}", of_a), fmt::format("{}", of_b)};
  };
  if (a.descriptor_kind != b.descriptor_kind) return differ("descriptor_kind", a.descriptor_kind, b.descriptor_kind);
  if (!(std::abs(a.scale_factor - b.scale_factor) <= kScaleFactorTolerance)) {
    return differ("scale_factor", a.scale_factor, b.scale_factor);
  }
  if (a.num_levels != b.num_levels) return differ("num_levels", a.num_levels, b.num_levels);
  if (a.patch_size_px != b.patch_size_px) return differ("patch_size_px", a.patch_size_px, b.patch_size_px);
  return std::nullopt;
}

}  // namespace mapp
