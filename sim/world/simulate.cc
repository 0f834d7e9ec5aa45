#include "sim/world/visit.h"
#include "sim/world/visit_plan.h"

namespace mapp::sim {
namespace {

constexpr double kPlaceStep_m = 0.2;

/// Adds where a trajectory passes, one point every 20 cm.
void AddPlaces(const std::vector<StampedPose>& trajectory, std::vector<Eigen::Vector3d>& places) {
  for (const StampedPose& pose : trajectory) {
    const Eigen::Vector3d& p_world = pose.T_world_camera.translation();
    if (places.empty() || (p_world - places.back()).norm() >= kPlaceStep_m) places.push_back(p_world);
  }
}

}  // namespace

StatusOr<std::shared_ptr<const Simulation>> Simulate(const SimulationOptions& options) {
  MAPP_ASSIGN_OR_RETURN(const VisitPlan plan, MakeVisitPlan(options));
  WorldOptions world_options;
  world_options.setting = options.setting;
  world_options.seed = options.seed;
  world_options.num_changes = options.num_changes;
  world_options.num_passers = options.num_passers;
  world_options.textures_folder = options.textures_folder;
  world_options.num_stable_visits = options.num_stable_visits;
  world_options.change_kinds = options.change_kinds;
  world_options.change_reach_m = options.change_reach_m;
  for (const auto& trajectory : plan.trajectories) AddPlaces(trajectory, world_options.keep_free_world);
  for (int user = 0; user < options.num_users; ++user) {
    world_options.visits_ns.emplace_back(plan.StartOf(user), plan.StartOf(user) + plan.longest_ns);
  }
  auto simulation = std::make_shared<Simulation>();
  simulation->options = options;
  if (options.change_reach_m > 0 && options.num_changes > 0) {
    // Ways lead through what never changes: they are the same in a world without changes.
    world_options.num_changes = 0;
    MAPP_ASSIGN_OR_RETURN(const auto unchanging, MakeWorld(world_options));
    MAPP_ASSIGN_OR_RETURN(const std::vector<Visit> visits, PlanVisits(*unchanging, options, plan));
    for (const Visit& visit : visits) AddPlaces(visit.poses, world_options.change_near_world);
    world_options.num_changes = options.num_changes;
  }
  MAPP_ASSIGN_OR_RETURN(simulation->world, MakeWorld(world_options));
  MAPP_ASSIGN_OR_RETURN(simulation->visits, PlanVisits(*simulation->world, options, plan));
  return std::shared_ptr<const Simulation>(std::move(simulation));
}

}  // namespace mapp::sim
