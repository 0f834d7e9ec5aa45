// The paper's figures on the server: optimization, memory, and the latency of each step.

#include "eval/experiments/experiment.h"
#include "eval/experiments/scenarios.h"

#include <fmt/format.h>

#include <array>

namespace mapp {
namespace {

/// Seconds that the server has spent in a step since its start.
double StepSeconds(const FleetFigures& fleet, size_t device, const std::string& step) {
  const Figures& server = fleet.devices[device].server;
  const std::string path = "steps." + step;
  return 1e-3 * server.Get(path + ".mean_ms").value_or(0) * server.Get(path + ".num_runs").value_or(0);
}

/// What one device's session added to it.
double AddedSeconds(const FleetFigures& fleet, size_t device, const std::string& step) {
  return StepSeconds(fleet, device, step) - (device == 0 ? 0 : StepSeconds(fleet, device - 1, step));
}

/// Mean of a step over all of a fleet's runs, ms.
Cell StepMean(const FleetFigures& fleet, const std::string& step) {
  return Cell(fleet.devices.back().server.Get("steps." + step + ".mean_ms"));
}

}  // namespace

StatusOr<ExperimentResult> RunServerLoad(EvalContext& context) {
  const sim::SimulationOptions world = SettingWorld(context, "garage");
  ExperimentResult result;
  result.setup = Describe(FleetOf(world, Level::kFeatures, "depth_sketch"));
  ResultTable table;
  table.id = "server_garage";
  table.title = "The server after each user";
  table.columns = {{"users", 0},
                   {"optimization upload all, s", 2},
                   {"optimization depth sketch, s", 2},
                   {"CPU upload all, s", 1},
                   {"CPU depth sketch, s", 1},
                   {"memory upload all, MB", 0},
                   {"memory depth sketch, MB", 0}};
  table.plot = Plot{
      Plot::Kind::kLines, "users", {"optimization upload all, s", "optimization depth sketch, s"}, "optimization, s"};
  std::array<std::shared_ptr<const FleetFigures>, 2> fleets;
  for (size_t i = 0; i < fleets.size(); ++i) {
    MAPP_ASSIGN_OR_RETURN(fleets[i],
                          context.lab.Run(FleetOf(world, Level::kFeatures, i == 0 ? "upload_all" : "depth_sketch")));
  }
  for (size_t user = 0; user < fleets[0]->devices.size(); ++user) {
    std::vector<Cell> row = {static_cast<double>(user + 1)};
    for (const auto& fleet : fleets) row.push_back(Cell(AddedSeconds(*fleet, user, "optimization")));
    for (const auto& fleet : fleets) row.push_back(fleet->devices[user].server_usage.cpu_s);
    for (const auto& fleet : fleets) {
      row.push_back(static_cast<double>(fleet->devices[user].server_usage.rss_bytes) * 1e-6);
    }
    table.rows.push_back(std::move(row));
  }
  ResultTable disk;
  disk.id = "server_disk";
  disk.title = "The database at the end";
  disk.columns = {{"policy"}, {"size, MB", 1}, {"KB per uploaded keyframe", 1}};
  for (size_t i = 0; i < fleets.size(); ++i) {
    const double keyframes = SumOf(*fleets[i], "keyframes_uploaded");
    const auto bytes = static_cast<double>(fleets[i]->database_bytes);
    disk.rows.push_back({std::string(i == 0 ? "upload all" : "depth sketch"), bytes * 1e-6,
                         keyframes > 0 ? Cell(bytes * 1e-3 / keyframes) : Cell()});
  }
  result.tables = {std::move(table), std::move(disk)};
  result.paper =
      "Covins needs 76 minutes for the global optimization with 20 users, Map++ much less; memory is 30 % lower "
      "with 20 users.";
  result.remarks = {
      "Optimization is bounded by what the session touched, not by the map: its time is that of each user's "
      "own closing. CPU is the server's in all since its start.",
      "Memory is what the process holds once the user's session is closed and optimized; it is not taken apart."};
  return result;
}

StatusOr<ExperimentResult> RunLatency(EvalContext& context) {
  const sim::SimulationOptions world = HallWorld(context);
  ExperimentResult result;
  result.setup = Describe(FleetOf(world, Level::kRendered, "depth_sketch"));
  ResultTable table;
  table.id = "latency";
  table.title = "Latency of each step, ms";
  table.columns = {{"step"},
                   {"paper, Covins"},
                   {"paper, Map++"},
                   {"upload all, mean", 2},
                   {"depth sketch, mean", 2},
                   {"depth sketch, worst p95", 2},
                   {"count", 0}};
  MAPP_ASSIGN_OR_RETURN(const auto all, context.lab.Run(FleetOf(world, Level::kRendered, "upload_all")));
  MAPP_ASSIGN_OR_RETURN(const auto sketch, context.lab.Run(FleetOf(world, Level::kRendered, "depth_sketch")));
  struct Step {
    const char* title;
    const char* covins;
    const char* paper;
    const char* path;
  };
  for (const Step& step :
       {Step{"overlap assessment (round trip)", "–", "9.1", "overlap_assessment"},
        Step{"redundancy control (device)", "–", "6.1", "redundancy_control"},
        Step{"keyframe upload (round trip, integration and commit included)", "16.5", "9.1", "keyframe_upload"},
        Step{"localization on the shared map (a frame)", "–", "8.8", "localization"},
        Step{"map sharing (a request, to the last byte)", "–", "127.4", "shared_map_request"},
        Step{"tracking on the device's own map (a frame)", "–", "–", "tracking"},
        Step{"local mapping (a keyframe)", "400", "400", "local_mapping"}}) {
    const std::string path = fmt::format("latency_ms.{}.", step.path);
    double worst_p95 = 0;
    for (const double p95 : Collect(*sketch, path + "p95")) worst_p95 = std::max(worst_p95, p95);
    const double count = SumOf(*sketch, path + "count");
    const auto mean = [&](const FleetFigures& fleet) -> Cell {
      double sum = 0;
      for (const DeviceFigures& device : fleet.devices) {
        sum += device.report.Get(path + "mean").value_or(0) * device.report.Get(path + "count").value_or(0);
      }
      const double calls = SumOf(fleet, path + "count");
      return calls > 0 ? Cell(sum / calls) : Cell();
    };
    table.rows.push_back({std::string(step.title), std::string(step.covins), std::string(step.paper), mean(*all),
                          mean(*sketch), count > 0 ? Cell(worst_p95) : Cell(), count});
  }
  table.rows.push_back({"map integration (server)", "8.4", "4.9", StepMean(*all, "integration"),
                        StepMean(*sketch, "integration"), Cell(),
                        Cell(sketch->devices.back().server.Get("steps.integration.num_runs"))});
  result.tables.push_back(std::move(table));
  result.remarks = {
      "Device and server share this machine's cores, and the drawing of images runs on them too: times are "
      "upper bounds. The paper's devices talk over Wi-Fi, these over loopback."};
  return result;
}

}  // namespace mapp
