#include "sim/world/visit.h"
#include "sim/world/visit_plan.h"

namespace mapp::sim {
namespace {

constexpr double kKeepFreeStep_m = 0.2;

/// Where the given trajectories pass, one point every 20 cm.
std::vector<Eigen::Vector3d> PlacesPassed(const VisitPlan& plan) {
  std::vector<Eigen::Vector3d> places;
  for (const auto& trajectory : plan.trajectories) {
    for (const StampedPose& pose : trajectory) {
      const Eigen::Vector3d& p_world = pose.T_world_camera.translation();
      if (places.empty() || (p_world - places.back()).norm() >= kKeepFreeStep_m) places.push_back(p_world);
    }
  }
  return places;
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
  world_options.keep_free_world = PlacesPassed(plan);
  for (int user = 0; user < options.num_users; ++user) {
    world_options.visits_ns.emplace_back(plan.StartOf(user), plan.StartOf(user) + plan.longest_ns);
  }
  auto simulation = std::make_shared<Simulation>();
  simulation->options = options;
  MAPP_ASSIGN_OR_RETURN(simulation->world, MakeWorld(world_options));
  MAPP_ASSIGN_OR_RETURN(simulation->visits, PlanVisits(*simulation->world, options, plan));
  return std::shared_ptr<const Simulation>(std::move(simulation));
}

}  // namespace mapp::sim
