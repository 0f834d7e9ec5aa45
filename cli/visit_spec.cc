#include "cli/visit_spec.h"

#include "eval/harness/choices.h"
#include "sim/world/world.h"

#include <fmt/format.h>
#include <fmt/ranges.h>

#include <algorithm>
#include <array>
#include <charconv>
#include <limits>
#include <optional>
#include <set>
#include <string_view>
#include <utility>
#include <vector>

namespace mapp {
namespace {

constexpr std::string_view kPrefix = "sim:";
constexpr const char* kForm = "sim:SETTING/USER or sim:SETTING:KEY=VALUE,.../USER expected";

/// The parts between the separators, empty ones included.
std::vector<std::string> Split(std::string_view text, char separator) {
  std::vector<std::string> parts;
  for (size_t begin = 0;;) {
    const size_t end = text.find(separator, begin);
    parts.emplace_back(text.substr(begin, end - begin));
    if (end == std::string_view::npos) return parts;
    begin = end + 1;
  }
}

/// A number that is all of the value.
template <typename T>
Status Parse(const std::string& key, const std::string& value, T& number) {
  const char* end_of_value = value.data() + value.size();
  const auto [end, error] = std::from_chars(value.data(), end_of_value, number);
  if (error == std::errc() && end == end_of_value) return absl::OkStatus();
  return absl::InvalidArgumentError(fmt::format("{}: a number expected, got '{}'", key, value));
}

using Setter = Status (*)(const std::string& key, const std::string& value, VisitSpec& spec);
struct Key {
  const char* name;
  Setter set;
};

Status SetCameras(const std::string& key, const std::string& value, VisitSpec& spec) {
  spec.simulation.cameras = Split(value, '+');
  for (const std::string& camera : spec.simulation.cameras) {
    MAPP_RETURN_IF_ERROR(Annotate(sim::MakeRig(camera, spec.simulation.sensor).status(), key));
  }
  return absl::OkStatus();
}

Status SetSensor(const std::string& key, const std::string& value, VisitSpec& spec) {
  const std::optional<SensorKind> sensor = ValueOf(kSensorChoices, value);
  if (!sensor) return absl::InvalidArgumentError(fmt::format("{}: {} is not {}", key, value, OneOf(kSensorChoices)));
  spec.simulation.sensor = *sensor;
  return absl::OkStatus();
}

Status SetChangeKinds(const std::string& key, const std::string& value, VisitSpec& spec) {
  spec.simulation.change_kinds.clear();
  for (const std::string& name : Split(value, '+')) {
    const std::optional<sim::ChangeKind> kind = ValueOf(kChangeKindChoices, name);
    if (!kind) return absl::InvalidArgumentError(fmt::format("{}: {} is not {}", key, name, OneOf(kChangeKindChoices)));
    spec.simulation.change_kinds.push_back(*kind);
  }
  return absl::OkStatus();
}

Status SetNoise(const std::string& key, const std::string& value, VisitSpec& spec) {
  double factor = 1;
  MAPP_RETURN_IF_ERROR(Parse(key, value, factor));
  spec.images.noise = ScaledNoise(factor);
  return absl::OkStatus();
}

Status SetExposureTime(const std::string& key, const std::string& value, VisitSpec& spec) {
  double exposure_ms = 0;
  MAPP_RETURN_IF_ERROR(Parse(key, value, exposure_ms));
  spec.images.exposure_s = exposure_ms / 1000;
  return absl::OkStatus();
}

#define MAPP_NUMBER(member) \
  [](const std::string& key, const std::string& value, VisitSpec& spec) { return Parse(key, value, spec.member); }

constexpr std::array<Key, 19> kKeys = {{
    {"users", MAPP_NUMBER(simulation.num_users)},
    {"path", MAPP_NUMBER(simulation.path_m)},
    {"seed", MAPP_NUMBER(simulation.seed)},
    {"camera", SetCameras},
    {"sensor", SetSensor},
    {"rate", MAPP_NUMBER(simulation.rate_hz)},
    {"changes", MAPP_NUMBER(simulation.num_changes)},
    {"changes-near", MAPP_NUMBER(simulation.change_reach_m)},
    {"change-kinds", SetChangeKinds},
    {"stable", MAPP_NUMBER(simulation.num_stable_visits)},
    {"passers", MAPP_NUMBER(simulation.num_passers)},
    {"trajectory",
     [](const std::string&, const std::string& value, VisitSpec& spec) {
       spec.simulation.trajectory_files = Split(value, '+');
       return absl::OkStatus();
     }},
    {"textures",
     [](const std::string&, const std::string& value, VisitSpec& spec) {
       spec.simulation.textures_folder = value;
       return absl::OkStatus();
     }},
    {"routes", MAPP_NUMBER(simulation.num_routes)},
    {"max-duration", MAPP_NUMBER(simulation.max_duration_s)},
    {"noise", SetNoise},
    {"exposure", MAPP_NUMBER(images.exposure)},
    {"motion-blur", MAPP_NUMBER(images.motion_blur)},
    {"exposure-ms", SetExposureTime},
}};

#undef MAPP_NUMBER

Status SetOption(const std::string& option, VisitSpec& spec, std::set<std::string>& given) {
  const size_t equals = option.find('=');
  if (equals == std::string::npos) {
    return absl::InvalidArgumentError(fmt::format("KEY=VALUE expected, got '{}'", option));
  }
  const std::string name = option.substr(0, equals);
  const auto key = std::ranges::find_if(kKeys, [&](const Key& k) { return name == k.name; });
  if (key == kKeys.end()) {
    std::vector<std::string> names;
    for (const Key& k : kKeys) names.emplace_back(k.name);
    return absl::InvalidArgumentError(fmt::format("'{}' is none of {}", name, fmt::join(names, ", ")));
  }
  if (!given.insert(name).second) return absl::InvalidArgumentError(fmt::format("{}: given twice", name));
  return key->set(name, option.substr(equals + 1), spec);
}

Status SetUser(const std::string& text, bool users_given, VisitSpec& spec) {
  if (!Parse("USER", text, spec.user).ok() || spec.user < 0 || spec.user == std::numeric_limits<int>::max()) {
    return absl::InvalidArgumentError(fmt::format("'{}' is no user's number; {}", text, kForm));
  }
  if (!users_given) {
    // Changes fall between visits: who sees which depends on how many visits there are.
    if (spec.simulation.num_changes > 0) return absl::InvalidArgumentError("changes: needs users=N as well");
    spec.simulation.num_users = spec.user + 1;
  }
  if (spec.user >= spec.simulation.num_users) {
    return absl::InvalidArgumentError(
        fmt::format("user {} of {}: they count from 0", spec.user, spec.simulation.num_users));
  }
  return absl::OkStatus();
}

StatusOr<VisitSpec> ParseParts(const std::string& text) {
  const size_t slash = text.rfind('/');
  if (!text.starts_with(kPrefix) || slash == std::string::npos) return absl::InvalidArgumentError(kForm);
  const std::string middle = text.substr(kPrefix.size(), slash - kPrefix.size());
  const size_t colon = middle.find(':');
  VisitSpec spec;
  spec.simulation.setting = middle.substr(0, colon);
  if (!std::ranges::count(sim::SettingNames(), spec.simulation.setting)) {
    return absl::InvalidArgumentError(
        fmt::format("setting '{}' is none of room, {}", spec.simulation.setting, fmt::join(sim::SettingNames(), ", ")));
  }
  std::set<std::string> given;
  if (colon != std::string::npos) {
    for (const std::string& option : Split(std::string_view(middle).substr(colon + 1), ',')) {
      MAPP_RETURN_IF_ERROR(SetOption(option, spec, given));
    }
  }
  MAPP_RETURN_IF_ERROR(SetUser(text.substr(slash + 1), given.contains("users"), spec));
  return spec;
}

}  // namespace

StatusOr<VisitSpec> ParseVisitSpec(const std::string& text) {
  StatusOr<VisitSpec> spec = ParseParts(text);
  if (!spec.ok()) return Annotate(spec.status(), text);
  return spec;
}

sim::SensorNoise ScaledNoise(double factor) {
  sim::SensorNoise noise = sim::ImageOptions().noise;
  noise.gray_sigma *= factor;
  noise.depth_sigma_per_m *= factor;
  if (factor == 0) noise.max_depth_m = std::numeric_limits<double>::infinity();
  return noise;
}

}  // namespace mapp
