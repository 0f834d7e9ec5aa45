#include "server/service/map_settings.h"

#include "mapp/feature/feature.h"

#include <fmt/format.h>

#include <algorithm>
#include <optional>

namespace mapp {
namespace {

constexpr size_t kMaxNameLength = 128;

}  // namespace

Status ValidateName(const std::string& name, const std::string& field) {
  const auto starts_character = [](char c) { return (static_cast<unsigned char>(c) & 0xC0U) != 0x80U; };
  const auto length = static_cast<size_t>(std::count_if(name.begin(), name.end(), starts_character));
  if (length == 0 || length > kMaxNameLength) {
    return absl::InvalidArgumentError(
        fmt::format("{}: must have 1 to {} characters, has {}", field, kMaxNameLength, length));
  }
  const auto is_control = [](char c) { return static_cast<unsigned char>(c) < 0x20 || c == 0x7F; };
  if (std::any_of(name.begin(), name.end(), is_control)) {
    return absl::InvalidArgumentError(fmt::format("{}: must not have control characters", field));
  }
  return absl::OkStatus();
}

Status CheckScaleIsComputedWith(const FeatureSettings& features) {
  FeatureSettings computed_with = features;
  computed_with.scale_factor = kPyramidScale;
  const std::optional<FeatureSettingsDifference> difference = FirstDifference(computed_with, features);
  if (!difference) return absl::OkStatus();
  return absl::InvalidArgumentError(fmt::format("feature_settings.{}: this server makes maps of {} only, got {}",
                                                difference->field, difference->a, difference->b));
}

}  // namespace mapp
