#include "eval/experiments/scenarios.h"

#include "eval/metrics/traffic_metrics.h"

#include <fmt/format.h>

namespace mapp {
namespace {

struct Size {
  int num_users;
  double path_m;
};

Size SizeOf(const EvalContext& context, const std::string& setting) {
  if (context.quick()) return {3, 30};
  // The paper's 20 users walked 2604, 2686 and 2358 m in all.
  if (setting == "plaza") return {20, 134};
  if (setting == "city") return {20, 118};
  return {20, 130};
}

}  // namespace

sim::SimulationOptions SettingWorld(const EvalContext& context, const std::string& setting, int num_users) {
  const Size size = SizeOf(context, setting);
  sim::SimulationOptions options;
  options.setting = setting;
  options.num_users = num_users > 0 ? num_users : size.num_users;
  options.path_m = size.path_m;
  options.seed = context.seed;
  options.sensor = setting == "city" ? SensorKind::kStereo : SensorKind::kRgbd;
  options.rate_hz = context.quick() ? 10 : 15;
  if (context.quick() && setting != "city") options.cameras = {"d455-640"};
  return options;
}

sim::SimulationOptions HallWorld(const EvalContext& context) {
  sim::SimulationOptions options;
  options.setting = "hall";
  options.seed = context.seed;
  options.sensor = SensorKind::kStereo;
  options.rate_hz = 20;  // EuRoC's: drones turn quickly
  options.num_users = context.quick() ? 3 : 5;
  options.path_m = context.quick() ? 12 : 80;
  // Recorded flights begin with half a minute on the ground: short cuts of them show nothing.
  if (!context.quick() && !context.flights.empty()) {
    options.trajectory_files = context.flights;
    options.num_users = static_cast<int>(context.flights.size());
  }
  return options;
}

std::string Describe(const FleetSpec& spec) {
  const std::string way = spec.world.trajectory_files.empty() ? fmt::format("users of {:.0f} m", spec.world.path_m)
                                                              : std::string("recorded flights");
  return fmt::format("{}, {} {}, {}, {}.", spec.world.setting, spec.world.num_users, way,
                     SensorKindName(spec.world.sensor), LevelName(spec.level));
}

std::optional<double> Kilobytes(const std::optional<double>& bytes) { return Scaled(bytes, 1e-3); }

std::optional<double> VanillaKilobytesPerKeyframe(const DeviceFigures& device) {
  const double moments =
      device.report.Get("keyframes").value_or(0) + device.report.Get("keyframe_equivalents").value_or(0);
  const auto features = device.report.Get("full_features");
  const auto points = device.report.Get("full_points");
  if (moments <= 0 || !features || !points) return std::nullopt;
  const uint64_t bytes =
      VanillaKeyframeBytes(static_cast<size_t>(*features / moments), static_cast<size_t>(*points / moments));
  return static_cast<double>(bytes) * 1e-3;
}

std::optional<double> Percent(const std::optional<double>& part, const std::optional<double>& whole) {
  if (!part || !whole || *whole == 0) return std::nullopt;
  return 100 * *part / *whole;
}

std::optional<double> Scaled(const std::optional<double>& value, double factor) {
  if (!value) return std::nullopt;
  return *value * factor;
}

}  // namespace mapp
