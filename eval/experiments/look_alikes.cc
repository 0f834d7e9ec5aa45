// Places that look alike: does the server ever take one for the other?

#include "eval/experiments/experiment.h"
#include "eval/experiments/scenarios.h"
#include "mapp/geometry/pose3.h"

#include <fmt/format.h>

#include <algorithm>
#include <limits>
#include <utility>

namespace mapp {
namespace {

/// Ways that come no nearer than this to each other belong to different places: the garage's aisles lie 16 m apart.
constexpr double kApart_m = 12;
/// A merge that puts the way this far from the truth, RMSE, has taken one place for the other. The tilt of a right one
/// stays far below over such a short way.
constexpr double kWrong_m = 1;
/// Ways to draw pairs from: each shares a stretch with an earlier one, so that it takes many, and long ones, to get
/// anywhere.
constexpr int kWays = 240;
constexpr double kWay_m = 40;

double NearestDistance(const std::vector<StampedPose>& a, const std::vector<StampedPose>& b) {
  // Every fifth pose: neighbours lie centimetres apart.
  constexpr size_t kStep = 5;
  double nearest_m = std::numeric_limits<double>::infinity();
  for (size_t i = 0; i < a.size(); i += kStep) {
    for (size_t j = 0; j < b.size(); j += kStep) {
      nearest_m = std::min(nearest_m, Distance(a[i].T_world_camera, b[j].T_world_camera));
    }
  }
  return nearest_m;
}

/// Visits of a founder and of a second device elsewhere, nobody twice.
std::vector<std::pair<int, int>> PairsApart(const sim::Simulation& simulation, size_t num_pairs) {
  std::vector<std::pair<int, int>> pairs;
  std::vector<bool> taken(simulation.visits.size(), false);
  for (size_t i = 0; i < taken.size() && pairs.size() < num_pairs; ++i) {
    if (taken[i]) continue;
    for (size_t j = i + 1; j < taken.size(); ++j) {
      if (taken[j] || NearestDistance(simulation.visits[i].poses, simulation.visits[j].poses) < kApart_m) continue;
      taken[i] = taken[j] = true;
      pairs.emplace_back(static_cast<int>(i), static_cast<int>(j));
      break;
    }
  }
  return pairs;
}

struct Tally {
  int trials = 0;
  int aligned = 0;
  int wrong = 0;
  double worst_m = 0;
};

StatusOr<Tally> Try(EvalContext& context, const sim::SimulationOptions& world, Level level, size_t num_trials) {
  MAPP_ASSIGN_OR_RETURN(const auto simulation, context.lab.WorldOf(world));
  Tally tally;
  for (const auto& [founder, other] : PairsApart(*simulation, num_trials)) {
    FleetSpec spec{.world = world, .level = level, .devices = {}};
    spec.devices = {{founder, "depth_sketch"}, {other, "depth_sketch"}};
    MAPP_ASSIGN_OR_RETURN(const auto fleet, context.lab.Run(spec));
    ++tally.trials;
    const std::optional<double> joint_m = fleet->devices.back().report.Get("ate_joint_m");
    if (!joint_m) continue;
    ++tally.aligned;
    tally.worst_m = std::max(tally.worst_m, *joint_m);
    if (*joint_m > kWrong_m) ++tally.wrong;
  }
  return tally;
}

StatusOr<ExperimentResult> Measure(EvalContext& context, Level level, const std::vector<std::string>& settings) {
  // Drawing takes most of a quick trial.
  const size_t num_quick_trials = level == Level::kRendered ? 1 : 3;
  const size_t num_trials = context.quick() ? num_quick_trials : 50;
  ExperimentResult result;
  ResultTable table;
  table.id = level == Level::kRendered ? "look_alikes_rendered" : "look_alikes";
  table.title = "A founder, and a second device elsewhere in the same world";
  table.columns = {{"setting"},    {"level"},           {"trials", 0},
                   {"aligned", 0}, {"wrong merges", 0}, {"largest joint ATE, m", 3}};
  for (const std::string& setting : context.Chosen(settings)) {
    sim::SimulationOptions world = SettingWorld(context, setting, kWays);
    world.path_m = kWay_m;
    MAPP_ASSIGN_OR_RETURN(const Tally tally, Try(context, world, level, num_trials));
    table.rows.push_back({setting, std::string(LevelName(level)), static_cast<double>(tally.trials),
                          static_cast<double>(tally.aligned), static_cast<double>(tally.wrong), tally.worst_m});
    result.setup += Describe(FleetOf(world, level, "depth_sketch")) + " ";
  }
  result.tables.push_back(std::move(table));
  result.remarks = {fmt::format(
      "Each trial has a server of its own and two ways that come no nearer than {:.0f} m to each other, among "
      "equal cars, pillars and textures. Some see a place in common from afar and align rightly; a merge "
      "counts as wrong when the second way's error in the founder's frame exceeds {:.0f} m.",
      kApart_m, kWrong_m)};
  return result;
}

}  // namespace

StatusOr<ExperimentResult> RunLookAlikes(EvalContext& context) {
  return Measure(context, Level::kFeatures, {"garage", "plaza", "city"});
}

StatusOr<ExperimentResult> RunRenderedLookAlikes(EvalContext& context) {
  return Measure(context, Level::kRendered, {"garage"});
}

}  // namespace mapp
