// The paper's figures on map quality: trajectories, surfaces, and what injection is worth.

#include "eval/experiments/experiment.h"
#include "eval/experiments/scenarios.h"
#include "eval/metrics/statistics.h"

#include <fmt/format.h>

#include <array>

namespace mapp {
namespace {

/// Error of each device in the map's frame; of the first, which defines it, its own.
std::vector<double> JointErrors(const FleetFigures& fleet) {
  std::vector<double> errors;
  for (const DeviceFigures& device : fleet.devices) {
    const auto joint = device.report.Get("ate_joint_m");
    const auto own = device.report.Get("ate_m");
    if (joint) {
      errors.push_back(*joint);
    } else if (own && errors.empty()) {
      errors.push_back(*own);
    }
  }
  return errors;
}

/// The paper has true surfaces in the city only; so that its runs serve both experiments.
bool IsReconstructed(const sim::SimulationOptions& world) {
  return world.setting == "city" || world.setting == "garage";
}

double NumAligned(const FleetFigures& fleet) {
  return static_cast<double>(Collect(fleet, "aligned_at_keyframe").size());
}

}  // namespace

StatusOr<ExperimentResult> RunHall(EvalContext& context) {
  const sim::SimulationOptions world = HallWorld(context);
  ExperimentResult result;
  result.setup = Describe(FleetOf(world, Level::kRendered, "depth_sketch"));
  ResultTable table;
  table.id = "hall";
  table.title = "Machine hall, one map: each flight";
  table.columns = {{"flight", 0},
                   {"frames with a pose in the map, %", 1},
                   {"ATE upload all, cm", 1},
                   {"ATE depth sketch, cm", 1},
                   {"joint ATE upload all, cm", 1},
                   {"joint ATE depth sketch, cm", 1},
                   {"upload all, KB/keyframe", 1},
                   {"depth sketch, KB/keyframe", 1},
                   {"aligned at keyframe", 0}};
  table.plot =
      Plot{Plot::Kind::kBars,
           "flight",
           {"ATE upload all, cm", "ATE depth sketch, cm", "joint ATE upload all, cm", "joint ATE depth sketch, cm"},
           "ATE, cm"};
  MAPP_ASSIGN_OR_RETURN(const auto all, context.lab.Run(FleetOf(world, Level::kRendered, "upload_all")));
  MAPP_ASSIGN_OR_RETURN(const auto sketch, context.lab.Run(FleetOf(world, Level::kRendered, "depth_sketch")));
  for (size_t flight = 0; flight < sketch->devices.size(); ++flight) {
    const Figures& a = all->devices[flight].report;
    const Figures& s = sketch->devices[flight].report;
    table.rows.push_back({static_cast<double>(flight + 1), Cell(Percent(s.Get("frames_aligned"), s.Get("frames"))),
                          Cell(Scaled(a.Get("ate_m"), 100)), Cell(Scaled(s.Get("ate_m"), 100)),
                          Cell(Scaled(a.Get("ate_joint_m"), 100)), Cell(Scaled(s.Get("ate_joint_m"), 100)),
                          Cell(Kilobytes(a.Get("upload_bytes_per_keyframe"))),
                          Cell(Kilobytes(s.Get("upload_bytes_per_keyframe"))), Cell(s.Get("aligned_at_keyframe"))});
  }
  result.tables.push_back(std::move(table));
  result.paper =
      "EuRoC, five flights: ATE of Covins 1.5, 1.7, 2.6, 4.6, 4.6 cm, of Map++ 2.0, 2.4, 2.6, 4.6, 7.8 cm; traffic of "
      "Covins 163, 168, 167, 161, 163 KB a keyframe, of Map++ 173, 67, 116, 104, 81.";
  result.remarks = {world.trajectory_files.empty()
                        ? "The ways are made up: recorded flights (--flights) are flown at full scale only."
                        : "The hall is drawn around the recorded flights; images are rendered, not recorded."};
  return result;
}

StatusOr<ExperimentResult> RunTrajectoryError(EvalContext& context) {
  ExperimentResult result;
  ResultTable table;
  table.id = "ate_settings";
  table.title = "Mean error of all users in the map's frame, m";
  table.columns = {
      {"setting"}, {"upload all", 3}, {"depth sketch", 3}, {"aligned, upload all", 0}, {"aligned, depth sketch", 0},
      {"users", 0}};
  table.plot = Plot{Plot::Kind::kBars, "setting", {"upload all", "depth sketch"}, "ATE, m"};
  for (const std::string& setting : context.Chosen({"garage", "plaza", "hall", "city"})) {
    const bool hall = setting == "hall";
    const sim::SimulationOptions world = hall ? HallWorld(context) : SettingWorld(context, setting);
    const Level level = hall ? Level::kRendered : Level::kFeatures;
    FleetSpec all_spec = FleetOf(world, level, "upload_all");
    FleetSpec sketch_spec = FleetOf(world, level, "depth_sketch");
    all_spec.reconstruct = sketch_spec.reconstruct = IsReconstructed(world);
    MAPP_ASSIGN_OR_RETURN(const auto all, context.lab.Run(all_spec));
    MAPP_ASSIGN_OR_RETURN(const auto sketch, context.lab.Run(sketch_spec));
    table.rows.push_back({setting, Cell(Mean(JointErrors(*all))), Cell(Mean(JointErrors(*sketch))), NumAligned(*all),
                          NumAligned(*sketch), static_cast<double>(world.num_users)});
    result.setup += Describe(FleetOf(world, level, "depth_sketch")) + " ";
  }
  result.tables.push_back(std::move(table));
  result.paper =
      "Map++ is 0.015 m worse than Covins in the garage, 0.009 m on EuRoC, 0.026 m in the city, and alike on "
      "the plaza.";
  result.remarks = {
      "Errors are in one frame: the first user's alignment with the truth judges everybody. Users who were "
      "never aligned have no error in the map and are told by the counts."};
  return result;
}

namespace {

StatusOr<ResultTable> MeasureReconstructions(EvalContext& context, const sim::SimulationOptions& world) {
  ResultTable table;
  table.id = "reconstruction_" + world.setting;
  table.title = "Distance of the map's points to the true surfaces, RMSE, m (" + world.setting + ")";
  table.columns = {{"users", 0},
                   {"upload all", 3},
                   {"depth sketch", 3},
                   {"median, depth sketch", 3},
                   {"points, upload all", 0},
                   {"points, depth sketch", 0}};
  table.plot = Plot{Plot::Kind::kLines, "users", {"upload all", "depth sketch"}, "RMSE, m"};
  FleetSpec all_spec = FleetOf(world, Level::kFeatures, "upload_all");
  FleetSpec sketch_spec = FleetOf(world, Level::kFeatures, "depth_sketch");
  all_spec.reconstruct = sketch_spec.reconstruct = IsReconstructed(world);
  MAPP_ASSIGN_OR_RETURN(const auto all, context.lab.Run(all_spec));
  MAPP_ASSIGN_OR_RETURN(const auto sketch, context.lab.Run(sketch_spec));
  for (size_t user = 0; user < all->devices.size(); ++user) {
    const auto& a = all->devices[user].reconstruction;
    const auto& s = sketch->devices[user].reconstruction;
    if (!a || !s) return absl::InternalError("a fleet was run without judging its map");
    table.rows.push_back({static_cast<double>(user + 1), a->distance_m.rms, s->distance_m.rms, s->distance_m.median,
                          static_cast<double>(a->distance_m.count), static_cast<double>(s->distance_m.count)});
  }
  return table;
}

}  // namespace

StatusOr<ExperimentResult> RunReconstruction(EvalContext& context) {
  ExperimentResult result;
  for (const std::string& setting : context.Chosen({"garage", "city"})) {
    const sim::SimulationOptions world = SettingWorld(context, setting);
    result.setup += Describe(FleetOf(world, Level::kFeatures, "depth_sketch")) + " ";
    MAPP_ASSIGN_OR_RETURN(ResultTable table, MeasureReconstructions(context, world));
    result.tables.push_back(std::move(table));
  }
  result.paper = "With 20 users the error of Map++ is 0.03 m above that of Covins; both grow with the users.";
  return result;
}

StatusOr<ExperimentResult> RunInjection(EvalContext& context) {
  const sim::SimulationOptions world = SettingWorld(context, "garage");
  ExperimentResult result;
  result.setup = Describe(FleetOf(world, Level::kFeatures, "depth_sketch"));
  ResultTable table;
  table.id = "injection_garage";
  table.title = "Redundancy injection";
  table.columns = {{"injection"}, {"joint ATE, m", 3}, {"upload, KB/keyframe", 1}, {"aligned", 0}, {"users", 0}};
  struct Row {
    const char* title;
    const char* policy;
  };
  for (const Row& row : {Row{"often observed", "depth_sketch"}, Row{"random, as many", "random_injection"},
                         Row{"none", "no_injection"}, Row{"(upload all)", "upload_all"}}) {
    MAPP_ASSIGN_OR_RETURN(const auto fleet, context.lab.Run(FleetOf(world, Level::kFeatures, row.policy)));
    table.rows.push_back({std::string(row.title), Cell(Mean(JointErrors(*fleet))),
                          Cell(Kilobytes(MeanOf(*fleet, "upload_bytes_per_keyframe"))), NumAligned(*fleet),
                          static_cast<double>(fleet->devices.size())});
  }
  result.tables.push_back(std::move(table));
  result.paper =
      "With 20 users in the garage, ATE falls from 0.245 m without injection to 0.182 m with random and 0.164 m "
      "with often observed points.";
  return result;
}

}  // namespace mapp
