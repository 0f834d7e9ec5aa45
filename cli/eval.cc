#include "cli/eval.h"

#include "cli/feature_source.h"
#include "cli/progress_bar.h"
#include "cli/replay.h"
#include "eval/experiments/experiment.h"
#include "eval/harness/report_folder.h"
#include "text/json_writer.h"

#include <fmt/format.h>
#include <fmt/ranges.h>

#include <algorithm>
#include <chrono>
#include <filesystem>
#include <map>
#include <mutex>
#include <sstream>

namespace mapp {
namespace {

namespace fs = std::filesystem;

/// The experiments of these names, or all, in the paper's order; those that measure in none of `settings` are left out.
/// "all" leaves out those that need a recording where none is given; asked for by name they are refused.
StatusOr<std::vector<Experiment>> Choose(const std::vector<std::string>& names,
                                         const std::vector<std::string>& settings, bool has_recording) {
  std::vector<std::string> known = {"all"};
  for (const Experiment& experiment : Experiments()) known.push_back(experiment.name);
  for (const std::string& name : names) {
    if (std::ranges::count(known, name) > 0) continue;
    return absl::InvalidArgumentError(fmt::format("no experiment {}; there are {}", name, fmt::join(known, ", ")));
  }
  std::vector<Experiment> chosen;
  for (const Experiment& experiment : Experiments()) {
    const bool is_named = std::ranges::count(names, experiment.name) > 0;
    if (experiment.needs_recording && !has_recording) {
      if (!is_named) continue;
      return absl::InvalidArgumentError(
          fmt::format("{}: needs a recorded sequence, --recorded FOLDER", experiment.name));
    }
    const bool is_wanted = is_named || std::ranges::count(names, "all") > 0;
    const bool is_in_setting =
        settings.empty() || std::ranges::find_first_of(experiment.settings, settings) != experiment.settings.end();
    if (is_wanted && is_in_setting) chosen.push_back(experiment);
  }
  if (!chosen.empty()) return chosen;
  return absl::InvalidArgumentError(
      fmt::format("{}: nothing is measured in {}", fmt::join(names, ", "), fmt::join(settings, " or ")));
}

/// Removed when it goes, unless it is to be kept.
class WorkFolder {
 public:
  WorkFolder(std::string path, bool keep) : path_(std::move(path)), keep_(keep) {}
  ~WorkFolder() {
    std::error_code ignored;  // a destructor has nobody to tell
    if (!keep_) fs::remove_all(path_, ignored);
  }
  WorkFolder(const WorkFolder&) = delete;
  WorkFolder& operator=(const WorkFolder&) = delete;
  const std::string& path() const { return path_; }

 private:
  const std::string path_;
  const bool keep_;
};

/// Plays devices without images; worlds are looked at once for all of them.
class FeaturePlayer {
 public:
  Status Play(const FeatureRun& run, const std::stop_token& stop) {
    const sim::Visit& visit = run.simulation->visits.at(static_cast<size_t>(run.visit));
    ReplayOptions options;
    options.server = run.server;
    options.map_name = run.map_name;
    options.device = run.device;
    options.sequence = fmt::format("{}/{}", run.simulation->options.setting, run.visit);
    options.level = ReplayLevel::kFeatures;
    options.participation = run.participation;
    options.json_file = run.json_file;
    options.trajectory_file = run.trajectory_file;
    options.truth_file = run.truth_file;
    options.patience = run.patience;
    if (!run.first_truth_file.empty())
      options.align_by = TrajectoryFiles{run.first_truth_file, run.first_trajectory_file};
    const auto source = MakeFeatureSource(options.sequence, WorldOf(run.simulation), visit,
                                          static_cast<uint64_t>(visit.poses.front().stamp_ns));
    std::ostringstream table;  // the figures are read from the JSON
    return RunReplay(options, *source, stop, table);
  }

 private:
  std::shared_ptr<const sim::FeatureWorld> WorldOf(const std::shared_ptr<const sim::Simulation>& simulation) {
    const std::lock_guard lock(mutex_);
    auto& world = worlds_[simulation];
    if (world == nullptr) world = std::make_shared<const sim::FeatureWorld>(simulation->world);
    return world;
  }

  std::mutex mutex_;
  std::map<std::shared_ptr<const sim::Simulation>, std::shared_ptr<const sim::FeatureWorld>> worlds_;
};

ResultSet HeaderOf(const EvalOptions& options) {
  ResultSet header;
  header.version = MAPP_VERSION;
  header.commit = MAPP_COMMIT;
  header.machine = DescribeMachine();
  header.command = options.command;
  header.scale = options.quick ? "quick" : "full";
  header.seed = options.seed;
  return header;
}

/// Takes back a folder that was made for nothing; one that was there before stays.
void RemoveIfMadeForNothing(const std::string& folder, bool was_there) {
  std::error_code ignored;
  if (!was_there) fs::remove(folder, ignored);  // fails when something is in it
}

Status RunExperiments(const EvalOptions& options, const std::vector<Experiment>& experiments,
                      const std::stop_token& stop, ReportFolder& folder, std::ostream& out) {
  const WorkFolder work((fs::path(options.out) / "work").string(), options.keep_work);
  LabOptions lab_options;
  MAPP_ASSIGN_OR_RETURN(lab_options.programs, FindPrograms());
  lab_options.work_folder = work.path();
  std::error_code error;
  // What an earlier run kept there would be taken for this one's: databases with maps in them, ports of its servers.
  fs::remove_all(work.path(), error);
  if (!error) fs::create_directories(work.path(), error);
  if (error) return absl::ResourceExhaustedError(fmt::format("{}: {}", work.path(), error.message()));

  ProgressBar bar("eval", experiments.size());
  size_t num_done = 0;
  lab_options.on_progress = [&](const std::string& what) {
    bar.Update(num_done, fmt::format("{}: {}", experiments[num_done].name, what));
  };
  FeaturePlayer features;
  lab_options.play_features = [&features](const FeatureRun& run, const std::stop_token& stop_run) {
    return features.Play(run, stop_run);
  };
  Lab lab(lab_options, stop);
  EvalContext context{lab,
                      options.quick ? Scale::kQuick : Scale::kFull,
                      options.seed,
                      options.flights,
                      options.settings,
                      options.recorded};
  for (; num_done < experiments.size(); ++num_done) {
    const Experiment& experiment = experiments[num_done];
    const auto start = std::chrono::steady_clock::now();
    StatusOr<ExperimentResult> result = experiment.run(context);
    if (!result.ok()) return Annotate(result.status(), experiment.name);
    result->name = experiment.name;
    result->title = experiment.title;
    result->duration_s = std::chrono::duration<double>(std::chrono::steady_clock::now() - start).count();
    if (!options.json) out << fmt::format("{:<16} {:7.1f} s\n", experiment.name, result->duration_s) << std::flush;
    MAPP_RETURN_IF_ERROR(folder.Add(std::move(*result), stop));
  }
  return absl::OkStatus();
}

void TellReport(const EvalOptions& options, const ReportFolder& folder, std::ostream& out) {
  const std::string report = (fs::path(options.out) / "REPORT.md").string();
  if (options.json) {
    JsonWriter json;
    json.BeginObject().Field("report", report).Field("results", (fs::path(options.out) / "results.json").string());
    const std::string& missing = folder.plots_missing();
    json.Field("plots_missing", missing.empty() ? std::nullopt : std::optional(missing)).EndObject();
    out << std::move(json).Finish();
    return;
  }
  out << report << '\n';
  if (!folder.plots_missing().empty()) out << "no plots: " << folder.plots_missing() << '\n';
}

}  // namespace

std::string ListExperiments() {
  std::string text;
  for (const Experiment& experiment : Experiments()) {
    text += fmt::format("  {:<16}{}\n", experiment.name, experiment.title);
  }
  return text;
}

Status RunEval(const EvalOptions& options, const std::stop_token& stop, std::ostream& out) {
  MAPP_ASSIGN_OR_RETURN(const std::vector<Experiment> experiments,
                        Choose(options.experiments, options.settings, !options.recorded.empty()));
  std::error_code ignored;  // what cannot be looked at is not there; Open says what is wrong
  const bool was_there = fs::exists(options.out, ignored);
  MAPP_ASSIGN_OR_RETURN(ReportFolder folder, ReportFolder::Open(options.out, HeaderOf(options)));
  const Status status = RunExperiments(options, experiments, stop, folder, out);
  RemoveIfMadeForNothing(options.out, was_there);
  MAPP_RETURN_IF_ERROR(status);
  TellReport(options, folder, out);
  return absl::OkStatus();
}

Status RunEvalReport(const EvalOptions& options, const std::stop_token& stop, std::ostream& out) {
  MAPP_ASSIGN_OR_RETURN(ReportFolder folder, ReportFolder::OpenExisting(options.out));
  MAPP_RETURN_IF_ERROR(folder.Write(stop));
  TellReport(options, folder, out);
  return absl::OkStatus();
}

}  // namespace mapp
