#include "sim/world/draft.h"

#include "sim/scene_rays.h"

#include <Eigen/Geometry>

#include <algorithm>
#include <array>
#include <cmath>
#include <memory>
#include <numbers>
#include <numeric>

namespace mapp::sim {
namespace {

constexpr double kQuarterTurn = std::numbers::pi / 2;

Eigen::Vector2d Axis(double yaw) { return {std::cos(yaw), std::sin(yaw)}; }

/// Whether two upright boxes, one grown by `gap_m`, share space: separating axes of their outlines on the ground
/// (Gottschalk et al. 1996), and their heights.
bool Touch(const Solid& a, const Solid& b, double gap_m) {
  const Eigen::Vector3d between = b.center_world - a.center_world;
  if (std::abs(between.z()) >= 0.5 * (a.size_m.z() + b.size_m.z())) return false;
  const auto reach = [](const Solid& solid, const Eigen::Vector2d& axis) {
    const Eigen::Vector2d x = Axis(solid.yaw);
    const Eigen::Vector2d y(-x.y(), x.x());
    return 0.5 * (solid.size_m.x() * std::abs(x.dot(axis)) + solid.size_m.y() * std::abs(y.dot(axis)));
  };
  for (const double yaw : {a.yaw, a.yaw + kQuarterTurn, b.yaw, b.yaw + kQuarterTurn}) {
    const Eigen::Vector2d axis = Axis(yaw);
    if (std::abs(axis.dot(between.head<2>())) >= reach(a, axis) + reach(b, axis) + gap_m) return false;
  }
  return true;
}

double Distance(const Eigen::Vector3d& p_world, const Solid& solid) {
  const Eigen::Vector3d p_box =
      Eigen::AngleAxisd(-solid.yaw, Eigen::Vector3d::UnitZ()) * (p_world - solid.center_world);
  return (p_box.cwiseAbs() - 0.5 * solid.size_m).cwiseMax(0.0).norm();
}

Solid SolidOf(const Eigen::Vector3d& size_m, const Eigen::Vector3d& ground_world, double yaw) {
  return {ground_world + Eigen::Vector3d(0, 0, 0.5 * size_m.z()), size_m, yaw};
}

/// Everything that stands anywhere at any time.
std::shared_ptr<const Scene> EverythingOf(const World& world) {
  auto scene = std::make_shared<Scene>(world.surroundings);
  for (const WorldObject& object : world.objects) {
    for (const ObjectPlacement& placement : object.placements) {
      if (placement.T_world_object) AppendTransformed(object.quads_object, *placement.T_world_object, scene->quads);
    }
  }
  return scene;
}

/// The nodes that the largest connected part holds, as flags.
std::vector<bool> LargestPart(size_t num_nodes, const std::vector<std::pair<size_t, size_t>>& edges) {
  std::vector<size_t> root(num_nodes);
  std::iota(root.begin(), root.end(), size_t{0});
  const auto find = [&](size_t node) {
    while (root[node] != node) node = root[node] = root[root[node]];
    return node;
  };
  for (const auto& [a, b] : edges) root[find(a)] = find(b);
  std::vector<size_t> count(num_nodes, 0);
  for (size_t i = 0; i < num_nodes; ++i) ++count[find(i)];
  const auto largest = static_cast<size_t>(std::ranges::max_element(count) - count.begin());
  std::vector<bool> inside(num_nodes, false);
  for (size_t i = 0; i < num_nodes; ++i) inside[i] = find(i) == largest;
  return inside;
}

}  // namespace

Draft::Draft(const WorldOptions& options, Materials& materials)
    : options_(options),
      materials_(materials),
      rng_(SeedOf(options.seed, 1)),
      scenery_(materials_, rng_, world.surroundings.quads) {
  world.setting = options.setting;
  world.seed = options.seed;
}

bool Draft::IsFree(const Solid& solid, double gap_m) const {
  return std::ranges::none_of(solids_, [&](const Solid& other) { return Touch(solid, other, gap_m); }) &&
         std::ranges::none_of(options_.keep_free_world, [&](const Eigen::Vector3d& p_world) {
           return Distance(p_world, solid) < options_.clearance_m;
         });
}

bool Draft::TryPut(const Thing& thing, const Eigen::Vector3d& ground_world, double yaw, double gap_m) {
  const Solid solid = SolidOf(thing.size_m, ground_world, yaw);
  if (!IsFree(solid, gap_m)) return false;
  Occupy(solid);
  AppendTransformed(thing.quads, UprightPose(ground_world, yaw), world.surroundings.quads);
  return true;
}

bool Draft::TryPutObject(const std::string& kind, uint32_t model, const Thing& thing,
                         const Eigen::Vector3d& ground_world, double yaw, double gap_m) {
  const Solid solid = SolidOf(thing.size_m, ground_world, yaw);
  if (!IsFree(solid, gap_m)) return false;
  Occupy(solid);
  WorldObject object;
  object.id = static_cast<uint32_t>(world.objects.size() + 1);
  object.kind = kind;
  object.model = model;
  object.size_m = thing.size_m;
  AppendTransformed(thing.quads, Pose3({1, 0, 0, 0}, {0, 0, -0.5 * thing.size_m.z()}), object.quads_object);
  for (Quad& quad : object.quads_object) quad.object_id = object.id;
  object.placements.push_back({.T_world_object = UprightPose(solid.center_world, yaw)});
  world.objects.push_back(std::move(object));
  return true;
}

bool Draft::TryAddSpot(const Spot& spot, double gap_m) {
  const Solid solid = SolidOf(spot.size_m, spot.ground_world, spot.yaw);
  if (!IsFree(solid, gap_m)) return false;
  Occupy(solid);
  free_spots.push_back(spot);
  return true;
}

void Draft::AddRoutes(const std::vector<Eigen::Vector3d>& nodes_world,
                      const std::vector<std::pair<size_t, size_t>>& edges) {
  constexpr double kStep_m = 0.2;
  const SceneRays rays(EverythingOf(world));
  std::vector<std::pair<size_t, size_t>> free_edges;
  for (const auto& [a, b] : edges) {
    const Eigen::Vector3d way = nodes_world[b] - nodes_world[a];
    std::vector<Eigen::Vector3d> samples;
    const auto num_steps = static_cast<int>(std::ceil(way.norm() / kStep_m));
    for (int i = 0; i <= num_steps; ++i) samples.push_back(nodes_world[a] + way * i / std::max(num_steps, 1));
    // Half a step more, for what lies between two samples.
    const double reach_m = world.routes.clearance_m + 0.5 * kStep_m;
    const bool may_pass = std::ranges::all_of(samples, [&](const Eigen::Vector3d& p_world) {
      return world.bounds_world.contains(p_world) && std::ranges::none_of(free_spots, [&](const Spot& spot) {
               return Distance(p_world, SolidOf(spot.size_m, spot.ground_world, spot.yaw)) < reach_m;
             });
    });
    if (may_pass && std::ranges::min(rays.DistanceToSurface(samples)) >= reach_m) free_edges.emplace_back(a, b);
  }
  if (free_edges.empty()) return;
  const std::vector<bool> connected = LargestPart(nodes_world.size(), free_edges);
  std::vector<size_t> new_index(nodes_world.size(), 0);
  for (size_t i = 0; i < nodes_world.size(); ++i) {
    if (!connected[i]) continue;
    new_index[i] = world.routes.nodes_world.size();
    world.routes.nodes_world.push_back(nodes_world[i]);
  }
  for (const auto& [a, b] : free_edges) {
    if (connected[a]) world.routes.edges.emplace_back(new_index[a], new_index[b]);
  }
}

}  // namespace mapp::sim
