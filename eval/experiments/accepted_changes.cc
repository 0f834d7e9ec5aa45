// What an accepted removal does for the next device on the way: beside a map that still holds what is gone, and one
// that was built afterwards.

#include "eval/experiments/experiment.h"
#include "eval/experiments/scenarios.h"
#include "eval/harness/change_detection.h"
#include "eval/harness/eval_server.h"

#include <fmt/format.h>

#include <algorithm>
#include <array>
#include <fstream>
#include <iterator>
#include <span>

namespace mapp {
namespace {

/// Surer changes are accepted without asking.
constexpr double kAutoAccept = 0.8;
/// The last visit's device takes part so.
constexpr const char* kPolicy = "depth_sketch";

/// Beside what the device reports.
constexpr const char* kNumAccepted = "changes_accepted";

struct MapKind {
  const char* title;
  bool is_built_after = false;
  bool is_accepted = false;
};
constexpr MapKind kKinds[] = {{.title = "as it was"},
                              {.title = "accepted", .is_accepted = true},
                              {.title = "built afterwards", .is_built_after = true}};

class NextDevice {
 public:
  NextDevice(EvalContext& context, const std::string& setting, uint64_t seed)
      : context_(context), num_before_(context.quick() ? 4 : 6), num_visits_(context.quick() ? 6 : 10) {
    world_ = SettingWorld(context, setting, num_visits_);
    world_.sensor = SensorKind::kRgbd;
    world_.rate_hz = 10;
    world_.path_m = context.quick() ? 20 : 30;
    world_.seed = seed;
    world_.num_routes = 1;
    world_.num_changes = 1;
    world_.change_kinds = {sim::ChangeKind::kVanished};
    // One change comes in the middle of the time that is left.
    world_.num_stable_visits = 2 * num_before_ - num_visits_ + 1;
    world_.change_reach_m = 6;
  }

  /// The device's report, on a map of this kind.
  StatusOr<Figures> Play(const MapKind& kind) {
    FleetSpec spec = FleetOf(world_, Level::kFeatures, "upload_all");
    const auto after = spec.devices.begin() + num_before_;
    spec.devices =
        kind.is_built_after ? std::vector(after, spec.devices.end() - 1) : std::vector(spec.devices.begin(), after + 1);
    MAPP_ASSIGN_OR_RETURN(const auto fleet, context_.lab.Run(spec));
    const std::string folder =
        fmt::format("{}/accepted_{}_{}_{}", context_.lab.options().work_folder, world_.setting, world_.seed,
                    std::distance(std::begin(kKinds), std::ranges::find(kKinds, kind.title, &MapKind::title)));
    MAPP_RETURN_IF_ERROR(CopyDatabase(fleet->database, folder).status());
    const std::stop_token& stop = context_.lab.stop();
    MAPP_ASSIGN_OR_RETURN(const auto server, EvalServer::Start(context_.lab.options().programs, folder, stop));
    std::optional<double> num_accepted;
    if (kind.is_accepted) {
      MAPP_ASSIGN_OR_RETURN(const ChangeDetection detection, DetectChanges(server->address(), stop, kAutoAccept));
      num_accepted = detection.num_accepted;
    }
    FeatureRun run;
    run.server = server->address();
    run.map_name = kEvalMapName;
    run.device = "next";
    run.participation = PolicyNamed(kPolicy).participation;
    MAPP_ASSIGN_OR_RETURN(run.simulation, context_.lab.WorldOf(world_));
    run.visit = num_visits_ - 1;
    run.patience = context_.lab.options().session_timeout;
    run.json_file = folder + "/next.json";
    run.trajectory_file = folder + "/next.traj";
    run.truth_file = folder + "/next.truth";
    MAPP_RETURN_IF_ERROR(context_.lab.options().play_features(run, stop));
    MAPP_RETURN_IF_ERROR(server->Stop(stop));
    std::ifstream file(run.json_file);
    const std::string json((std::istreambuf_iterator<char>(file)), {});
    MAPP_ASSIGN_OR_RETURN(Figures report, Figures::Parse(json, run.json_file));
    if (num_accepted) report.Set(kNumAccepted, *num_accepted);
    return report;
  }

 private:
  EvalContext& context_;
  const int num_before_;  ///< visits before the thing leaves
  const int num_visits_;
  sim::SimulationOptions world_;
};

std::optional<double> ShareOnSharedMap(const Figures& report) {
  return 100 * report.Get("frames_on_shared_map").value_or(0) / report.Get("frames").value_or(1);
}

}  // namespace

StatusOr<ExperimentResult> RunAcceptedChanges(EvalContext& context) {
  ExperimentResult result;
  ResultTable table;
  table.id = "accepted";
  table.title = "The next device on the way, medians over the seeds";
  table.columns = {{"setting"},
                   {"map"},
                   {"seeds", 0},
                   {"changes accepted", 0},
                   {"frames on the shared map, %", 1},
                   {"matches a frame", 1},
                   {"failures", 0},
                   {"update reports", 0},
                   {"upload, KB", 1}};
  const int num_seeds = context.quick() ? 1 : 3;
  for (const std::string& setting : context.Chosen({"garage"})) {
    std::array<std::vector<Figures>, std::size(kKinds)> reports;
    for (int i = 0; i < num_seeds; ++i) {
      NextDevice device(context, setting, context.seed + static_cast<uint64_t>(i));
      for (size_t k = 0; k < std::size(kKinds); ++k) {
        MAPP_ASSIGN_OR_RETURN(Figures report, device.Play(kKinds[k]));
        reports[k].push_back(std::move(report));
      }
    }
    for (size_t k = 0; k < std::size(kKinds); ++k) {
      const auto median = [&](const auto& figure) -> Cell {
        std::vector<double> values;
        for (const Figures& report : reports[k]) {
          if (const std::optional<double> value = figure(report)) values.push_back(*value);
        }
        return Median(values);
      };
      const auto of = [](const char* name) { return [name](const Figures& report) { return report.Get(name); }; };
      table.rows.push_back(
          {setting, kKinds[k].title, Cell(num_seeds), median(of(kNumAccepted)), median(ShareOnSharedMap),
           median(of("shared_matches_mean")), median(of("sharing_failures")), median(of("update_reports")),
           median([](const Figures& report) { return std::optional(report.Get("upload_bytes").value_or(0) / 1e3); })});
    }
  }
  result.tables = {std::move(table)};
  result.setup = fmt::format(
      "Two things leave beside the way. As it was: visits before, and one after. Accepted: the same map, on which "
      "changes "
      "of confidence {:.1f} and more were accepted. Built afterwards: as many visits, all after they had left. Then "
      "one "
      "more visit, by policy {}.",
      kAutoAccept, kPolicy);
  result.paper = "The paper does not change maps.";
  return result;
}

}  // namespace mapp
