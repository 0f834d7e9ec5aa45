#include "eval/harness/fleet.h"

#include "eval/harness/choices.h"
#include "eval/metrics/statistics.h"
#include "mapp/base/check.h"

#include <fmt/format.h>
#include <fmt/ranges.h>

#include <algorithm>
#include <functional>
#include <numeric>
#include <utility>

namespace mapp {

const char* LevelName(Level level) { return level == Level::kRendered ? "rendered images" : "feature level"; }

namespace {

Policy MakePolicy(std::string name, std::string title, const std::function<void(ParticipantOptions&)>& set) {
  Policy policy{std::move(name), std::move(title), {}};
  set(policy.participation);
  return policy;
}

std::vector<Policy> MakePolicies() {
  using P = ParticipantOptions;
  return {
      MakePolicy("upload_all", "upload all", [](P& p) { p.policy = UploadPolicy::kUploadAll; }),
      MakePolicy("depth_sketch", "depth sketch", [](P& p) { p.sampler = SamplerKind::kDepthSketch; }),
      MakePolicy("uniform", "uniform", [](P& p) { p.sampler = SamplerKind::kUniform; }),
      MakePolicy("occupancy", "occupancy", [](P& p) { p.sampler = SamplerKind::kOccupancy; }),
      MakePolicy("no_injection", "no injection", [](P& p) { p.injection = Injection::kNone; }),
      MakePolicy("random_injection", "random injection", [](P& p) { p.injection = Injection::kRandom; }),
      MakePolicy("no_sharing", "no sharing", [](P& p) { p.sharing = false; }),
      MakePolicy("alpha_1", "alpha 1",
                 [](P& p) {
                   p.oversharing = 1;
                   p.look_ahead_m = 0;
                 }),
      MakePolicy("alpha_1.3", "alpha 1.3", [](P& p) { p.look_ahead_m = 0; }),
      MakePolicy("look_ahead_10", "look-ahead 10 m", [](P& p) { p.look_ahead_m = 10; }),
      MakePolicy("look_ahead_20", "look-ahead 20 m", [](P& p) { p.look_ahead_m = 20; }),
  };
}

}  // namespace

const Policy& PolicyNamed(const std::string& name) {
  static const std::vector<Policy> kPolicies = MakePolicies();
  const auto found = std::ranges::find(kPolicies, name, &Policy::name);
  MAPP_CHECK(found != kPolicies.end());
  return *found;
}

std::vector<std::string> ReplayArguments(const ParticipantOptions& participation) {
  const std::string policy = NameOf(kPolicyChoices, participation.policy);
  if (participation.policy == UploadPolicy::kUploadAll) return {"--policy", policy};
  return {"--policy",     policy,
          "--sampler",    NameOf(kSamplerChoices, participation.sampler),
          "--injection",  NameOf(kInjectionChoices, participation.injection),
          "--sharing",    NameOf(kSwitchChoices, participation.sharing),
          "--alpha",      fmt::format("{}", participation.oversharing),
          "--look-ahead", fmt::format("{}", participation.look_ahead_m)};
}

std::string FleetSpec::Key() const {
  std::string key = fmt::format(
      "{} users={} path={} seed={} sensor={} rate={} changes={} passers={} cameras={} "
      "flights={} textures={} level={} concurrent={} routes={} cut={} reconstruct={} near={} stable={} kinds=",
      world.setting, world.num_users, world.path_m, world.seed, static_cast<int>(world.sensor), world.rate_hz,
      world.num_changes, world.num_passers, fmt::join(world.cameras, "+"), fmt::join(world.trajectory_files, "+"),
      world.textures_folder, LevelName(level), concurrent, world.num_routes, world.max_duration_s, reconstruct,
      world.change_reach_m, world.num_stable_visits);
  for (const sim::ChangeKind kind : world.change_kinds) key += NameOf(kChangeKindChoices, kind) + "+";
  for (const Participation& device : devices)
    key += fmt::format(" {}:{}:{}", device.visit, device.policy, device.tile_cache);
  return key;
}

FleetSpec FleetOf(const sim::SimulationOptions& world, Level level, const std::string& policy) {
  FleetSpec spec;
  spec.world = world;
  spec.level = level;
  for (int visit = 0; visit < world.num_users; ++visit) spec.devices.push_back({visit, policy});
  return spec;
}

std::vector<double> Collect(const FleetFigures& fleet, const std::string& path) {
  std::vector<double> values;
  for (const DeviceFigures& device : fleet.devices) {
    if (const auto value = device.report.Get(path)) values.push_back(*value);
  }
  return values;
}

double SumOf(const FleetFigures& fleet, const std::string& path) {
  const std::vector<double> values = Collect(fleet, path);
  return std::accumulate(values.begin(), values.end(), 0.0);
}

std::optional<double> MeanOf(const FleetFigures& fleet, const std::string& path) { return Mean(Collect(fleet, path)); }

}  // namespace mapp
