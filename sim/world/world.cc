#include "sim/world/world.h"

#include "sim/world/draft.h"
#include "sim/world/materials.h"

#include <fmt/format.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <exception>
#include <iterator>

namespace mapp::sim {
namespace {

constexpr int kMaxPassers = 1000;

struct Setting {
  const char* name;
  void (*build)(Draft&);
};
constexpr std::array kSettings = {Setting{"garage", BuildGarage}, Setting{"plaza", BuildPlaza},
                                  Setting{"hall", BuildHall}, Setting{"city", BuildCity}};

Status Validate(const WorldOptions& options) {
  if (std::ranges::find(SettingNames(), options.setting) == SettingNames().end()) {
    return absl::InvalidArgumentError(
        fmt::format("setting: unknown \"{}\"; there are {}", options.setting, fmt::join(SettingNames(), ", ")));
  }
  if (options.num_changes < 0) {
    return absl::InvalidArgumentError(fmt::format("num_changes: {} is negative", options.num_changes));
  }
  if (options.num_passers < 0 || options.num_passers > kMaxPassers) {
    return absl::InvalidArgumentError(
        fmt::format("num_passers: {} is not in [0, {}]", options.num_passers, kMaxPassers));
  }
  if (!(options.clearance_m >= 0 && options.clearance_m <= 10)) {
    return absl::InvalidArgumentError(fmt::format("clearance_m: {} is not in [0, 10]", options.clearance_m));
  }
  if (options.num_stable_visits < 0 || static_cast<size_t>(options.num_stable_visits) > options.visits_ns.size()) {
    return absl::InvalidArgumentError(fmt::format("num_stable_visits: {} is not in [0, {}], the visits",
                                                  options.num_stable_visits, options.visits_ns.size()));
  }
  if (!(options.change_reach_m >= 0 && options.change_reach_m <= 1000)) {
    return absl::InvalidArgumentError(fmt::format("change_reach_m: {} is not in [0, 1000]", options.change_reach_m));
  }
  for (const auto& [from_ns, to_ns] : options.visits_ns) {
    if (from_ns > to_ns) {
      return absl::InvalidArgumentError(
          fmt::format("visits_ns: a visit ends at {} before it starts at {}", to_ns, from_ns));
    }
  }
  constexpr double kFarthest_m = 1e4;
  for (const Eigen::Vector3d& p_world : options.keep_free_world) {
    if (!(p_world.cwiseAbs().maxCoeff() <= kFarthest_m)) {
      return absl::InvalidArgumentError(fmt::format("keep_free_world: ({}, {}, {}) is no place within {} m",
                                                    p_world.x(), p_world.y(), p_world.z(), kFarthest_m));
    }
  }
  return absl::OkStatus();
}

void AddPassers(int count, const std::vector<std::vector<Eigen::Vector3d>>& walks_world, Materials& materials,
                uint64_t seed, World& world) {
  Rng rng(SeedOf(seed, 3));
  for (int i = 0; i < count; ++i) {
    Passer passer;
    passer.quads_object = MakePerson(materials, rng).quads;
    passer.route_world = walks_world[rng.Below(walks_world.size())];
    passer.speed_m_s = rng.Uniform(0.8, 1.5);
    passer.phase_m = rng.Uniform(0, 200);
    world.passers.push_back(std::move(passer));
  }
}

/// Where the walker is, and where to: there and back for ever.
Pose3 PoseOnWalk(const Passer& passer, int64_t stamp_ns) {
  const std::vector<Eigen::Vector3d>& route = passer.route_world;
  double length_m = 0;
  for (size_t i = 1; i < route.size(); ++i) length_m += (route[i] - route[i - 1]).norm();
  double along_m = std::fmod(passer.phase_m + passer.speed_m_s * 1e-9 * static_cast<double>(stamp_ns), 2 * length_m);
  if (along_m < 0) along_m += 2 * length_m;
  const bool back = along_m > length_m;
  if (back) along_m = 2 * length_m - along_m;
  for (size_t i = 1; i < route.size(); ++i) {
    const Eigen::Vector3d piece = route[i] - route[i - 1];
    if (along_m > piece.norm() && i + 1 < route.size()) {
      along_m -= piece.norm();
      continue;
    }
    const Eigen::Vector3d heading = back ? Eigen::Vector3d(-piece) : piece;
    return UprightPose(route[i - 1] + along_m * piece.normalized(), std::atan2(heading.y(), heading.x()));
  }
  return UprightPose(route.front(), 0);
}

StatusOr<std::shared_ptr<const World>> Make(const WorldOptions& options) {
  Materials materials(SeedOf(options.seed, 0));
  if (!options.textures_folder.empty()) MAPP_RETURN_IF_ERROR(materials.PaperWallsWith(options.textures_folder));
  Draft draft(options, materials);
  std::ranges::find(kSettings, options.setting, [](const Setting& setting) { return setting.name; })->build(draft);
  World& world = draft.world;
  MAPP_RETURN_IF_ERROR(AddChanges(options, draft.free_spots, world));
  AddPassers(options.num_passers, draft.walks_world, materials, options.seed, world);
  return std::make_shared<const World>(std::move(world));
}

}  // namespace

const std::optional<Pose3>& WorldObject::At(int64_t stamp_ns) const {
  const auto after = std::ranges::upper_bound(placements, stamp_ns, {}, &ObjectPlacement::from_ns);
  return std::prev(after)->T_world_object;
}

Scene SceneAt(const World& world, int64_t stamp_ns) {
  Scene scene = world.surroundings;
  for (const WorldObject& object : world.objects) {
    const std::optional<Pose3>& T_world_object = object.At(stamp_ns);
    if (T_world_object) AppendTransformed(object.quads_object, *T_world_object, scene.quads);
  }
  return scene;
}

std::vector<Quad> PassersAt(const World& world, int64_t stamp_ns) {
  std::vector<Quad> quads;
  for (const Passer& passer : world.passers)
    AppendTransformed(passer.quads_object, PoseOnWalk(passer, stamp_ns), quads);
  return quads;
}

const std::vector<std::string>& SettingNames() {
  static const std::vector<std::string> kNames = [] {
    std::vector<std::string> names;
    for (const Setting& setting : kSettings) names.emplace_back(setting.name);
    return names;
  }();
  return kNames;
}

StatusOr<std::shared_ptr<const World>> MakeWorld(const WorldOptions& options) {
  MAPP_RETURN_IF_ERROR(Validate(options));
  try {
    return Make(options);
  } catch (const std::exception& exception) {  // OpenCV, threads and the allocator: only for want of memory
    return absl::ResourceExhaustedError(fmt::format("making the {}: {}", options.setting, exception.what()));
  }
}

}  // namespace mapp::sim
