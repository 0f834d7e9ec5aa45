// What the service finds of a world's changes, and what it invents: histories of visits to worlds whose true changes
// are known. Medians over worlds of several seeds.

#include "eval/experiments/experiment.h"
#include "eval/experiments/scenarios.h"
#include "eval/harness/change_detection.h"
#include "eval/harness/choices.h"
#include "eval/harness/eval_server.h"
#include "eval/harness/visible_changes.h"
#include "eval/metrics/change_metrics.h"
#include "eval/metrics/trajectory_metrics.h"
#include "storage/sqlite/sqlite_map_store.h"

#include <fmt/format.h>

#include <algorithm>
#include <fstream>
#include <map>
#include <numbers>

namespace mapp {
namespace {

constexpr double kGoodIou = 0.3;

/// A history of visits, and what happens between them.
struct History {
  std::string title;
  int num_visits = 12;
  int num_changes = 0;
  std::vector<sim::ChangeKind> kinds = {};
  int num_stable_visits = 0;
  int num_passers = 0;
  int num_routes = 1;
  std::string policy = "upload_all";
  bool is_displaced = false;  ///< each visit's poses are wrong by up to kMaxOffset_m and kMaxTurn_rad
  bool is_timed = false;      ///< also a rerun, and one more visit
};

constexpr double kMaxOffset_m = 0.1;
constexpr double kMaxTurn_rad = std::numbers::pi / 180;
constexpr double kReach_m = 6;
constexpr double kGreatestReach_m = 48;

std::vector<History> Histories(bool quick) {
  const std::vector<sim::ChangeKind> vanished = {sim::ChangeKind::kVanished};
  const int before = quick ? 2 : 4;
  std::vector<History> histories = {{.title = "two leave, one visit after",
                                     .num_visits = before + 1,
                                     .num_changes = 2,
                                     .kinds = vanished,
                                     .num_stable_visits = before}};
  if (quick) {
    histories.push_back({.title = "history", .num_visits = 4, .num_changes = 4, .num_passers = 4, .is_timed = true});
    histories.push_back({.title = "unchanged, poses wrong", .num_visits = 4, .num_passers = 4, .is_displaced = true});
    return histories;
  }
  const History whole = {.title = "ten changes, all history",
                         .num_changes = 11,  // one of them comes after all visits but the timed one
                         .num_passers = 8,
                         .num_routes = 2,
                         .is_timed = true};
  histories.push_back(whole);
  histories.push_back(
      {.title = "ten changes, one visit after", .num_changes = 10, .num_stable_visits = 11, .num_passers = 8});
  histories.push_back({.title = "unchanged, poses wrong", .num_visits = 20, .num_passers = 8, .is_displaced = true});
  histories.push_back(whole);
  histories.back().title += ", depth sketch";
  histories.back().policy = "depth_sketch";
  histories.back().is_timed = false;
  return histories;
}

sim::SimulationOptions HistoryWorld(const EvalContext& context, const std::string& setting, const History& history,
                                    uint64_t seed) {
  sim::SimulationOptions world = SettingWorld(context, setting, history.num_visits + (history.is_timed ? 1 : 0));
  world.sensor = SensorKind::kRgbd;
  world.rate_hz = 10;
  world.path_m = context.quick() ? 20 : 30;
  world.seed = seed;
  world.num_routes = std::min(history.num_routes, world.num_users);
  world.num_changes = history.num_changes;
  world.change_kinds = history.kinds;
  world.num_stable_visits = history.num_stable_visits;
  world.change_reach_m = kReach_m;
  world.num_passers = history.num_passers;
  return world;
}

/// What one seed's history gave.
struct Outcome {
  ChangeScore score;
  size_t num_points = 0;
  size_t num_sessions = 0;
  ChangeDetection scan;
  std::optional<ChangeDetection> rerun;
  std::optional<ChangeDetection> after_one_more;
};

Status CountMap(const std::string& database, Outcome& outcome) {
  MAPP_ASSIGN_OR_RETURN(const std::unique_ptr<MapStore> store, OpenSqliteMapStore(database, {.read_only = true}));
  MAPP_ASSIGN_OR_RETURN(const std::unique_ptr<MapReader> reader, store->Read());
  MAPP_ASSIGN_OR_RETURN(const MapRecord map, reader->FindMap(kEvalMapName));
  MAPP_ASSIGN_OR_RETURN(const std::vector<SessionRecord> sessions, reader->ListSessions(map.id));
  outcome.num_points = static_cast<size_t>(map.num_points);
  outcome.num_sessions = sessions.size();
  return absl::OkStatus();
}

/// Where the map lies in the world.
StatusOr<Pose3> FindMapInWorld(const FleetFigures& fleet) {
  MAPP_ASSIGN_OR_RETURN(const auto truth, ReadTumTrajectory(fleet.first_truth_file));
  MAPP_ASSIGN_OR_RETURN(const auto trajectory, ReadTumTrajectory(fleet.first_trajectory_file));
  MAPP_ASSIGN_OR_RETURN(const TrajectoryError error, AbsoluteTrajectoryError(truth, trajectory, /*with_scale=*/false));
  return error.T_truth_estimate.pose;
}

void TakeToWorld(const Pose3& T_world_map, std::vector<DetectedChange>& changes) {
  for (DetectedChange& change : changes) {
    for (std::optional<OrientedBox>* box : {&change.before, &change.after}) {
      if (*box) (*box)->T_frame_box = T_world_map * (*box)->T_frame_box;
    }
  }
}

std::string Tell(const char* what, sim::ChangeKind kind, const std::optional<OrientedBox>& before,
                 const std::optional<OrientedBox>& after) {
  std::string text = fmt::format("{} {}", what, NameOf(kChangeKindChoices, kind));
  for (const auto& [name, box] : {std::pair("before", before), std::pair("after", after)}) {
    if (!box) continue;
    const Eigen::Vector3d& p_world = box->T_frame_box.translation();
    text += fmt::format(", {} at {:.1f} {:.1f} {:.1f}, size {:.1f} {:.1f} {:.1f}", name, p_world.x(), p_world.y(),
                        p_world.z(), box->size_m.x(), box->size_m.y(), box->size_m.z());
  }
  return text + "\n";
}

/// For who wants to know why (--keep-work): all lists in the world's frame, and what came of them.
Status WriteLists(const std::string& title, const std::vector<TrueChange>& changes,
                  const std::vector<TrueChange>& others, const Outcome& outcome, const std::string& folder) {
  std::string text = title + "\n";
  for (const TrueChange& change : changes) text += Tell("true", change.kind, change.before, change.after);
  for (const TrueChange& other : others) text += Tell("hardly visible", other.kind, other.before, other.after);
  for (const DetectedChange& found : outcome.scan.changes) {
    text += Tell("detected", found.kind, found.before, found.after);
  }
  const ChangeCounts& all = outcome.score.all;
  text += fmt::format("{} true, {} found, {} detected, {} right, {:.2f} s\n", all.num_true, all.num_found,
                      all.num_detected, all.num_right, outcome.scan.seconds);
  std::ofstream file(folder + "/changes.txt");
  file << text;
  file.close();
  return file ? absl::OkStatus() : absl::ResourceExhaustedError(folder + "/changes.txt: cannot be written");
}

/// Takes out what tells of a change that was hardly visible: neither right nor wrong.
Status DropOthers(const std::vector<TrueChange>& changes, const std::vector<TrueChange>& others,
                  std::vector<DetectedChange>& detected) {
  std::vector<DetectedChange> kept;
  for (const DetectedChange& one : detected) {
    MAPP_ASSIGN_OR_RETURN(const ChangeScore of_visible, ScoreChanges(changes, {&one, 1}));
    MAPP_ASSIGN_OR_RETURN(const ChangeScore of_others, ScoreChanges(others, {&one, 1}));
    if (of_visible.all.num_right > 0 || of_others.all.num_right == 0) kept.push_back(one);
  }
  detected = std::move(kept);
  return absl::OkStatus();
}

/// Plays histories and has their changes detected.
class Histographer {
 public:
  explicit Histographer(EvalContext& context) : context_(context), num_seeds_(context.quick() ? 1 : 3) {}

  int num_seeds() const { return num_seeds_; }
  const std::string& setup() const { return setup_; }

  StatusOr<Outcome> Measure(const std::string& setting, const History& history, uint64_t seed) {
    sim::SimulationOptions world = HistoryWorld(context_, setting, history, seed);
    // Some ways have few things beside them, and some worlds have few.
    while (absl::IsInvalidArgument(context_.lab.WorldOf(world).status()) && world.num_changes > 1) {
      if (world.change_reach_m < kGreatestReach_m) {
        world.change_reach_m *= 2;
      } else {
        --world.num_changes;
      }
    }
    StatusOr<Outcome> outcome = MeasureOne(world, history);
    if (!outcome.ok()) {
      return Annotate(outcome.status(), fmt::format("{}, {}, seed {}", setting, history.title, seed));
    }
    return outcome;
  }

 private:
  StatusOr<Outcome> MeasureOne(const sim::SimulationOptions& world, const History& history) {
    FleetSpec spec = FleetOf(world, Level::kFeatures, history.policy);
    spec.devices.resize(static_cast<size_t>(history.num_visits));
    setup_ = fmt::format("{}, ways of {:.0f} m, {}, {}.", world.setting, world.path_m, SensorKindName(world.sensor),
                         LevelName(spec.level));
    MAPP_ASSIGN_OR_RETURN(const auto fleet, context_.lab.Run(spec));
    const std::string folder = fmt::format("{}/changes_{:03d}", context_.lab.options().work_folder, num_measured_++);
    MAPP_ASSIGN_OR_RETURN(const std::string database, CopyDatabase(fleet->database, folder));
    if (history.is_displaced) {
      MAPP_RETURN_IF_ERROR(DisplaceSessions(database, kMaxOffset_m, kMaxTurn_rad, world.seed));
    }
    Outcome outcome;
    MAPP_RETURN_IF_ERROR(CountMap(database, outcome));
    const std::stop_token& stop = context_.lab.stop();
    MAPP_ASSIGN_OR_RETURN(const auto server, EvalServer::Start(context_.lab.options().programs, folder, stop));
    MAPP_ASSIGN_OR_RETURN(outcome.scan, DetectChanges(server->address(), stop));
    if (history.is_timed) MAPP_RETURN_IF_ERROR(TimeMore(world, history, server->address(), folder, outcome));
    MAPP_RETURN_IF_ERROR(server->Stop(stop));
    MAPP_RETURN_IF_ERROR(Score(*fleet, world, history, folder, outcome));
    return outcome;
  }

  /// The same again, and with another visit.
  Status TimeMore(const sim::SimulationOptions& world, const History& history, const std::string& address,
                  const std::string& folder, Outcome& outcome) {
    const std::stop_token& stop = context_.lab.stop();
    MAPP_ASSIGN_OR_RETURN(outcome.rerun, DetectChanges(address, stop));
    FeatureRun run;
    run.server = address;
    run.map_name = kEvalMapName;
    run.device = "one_more";
    run.participation = PolicyNamed(history.policy).participation;
    MAPP_ASSIGN_OR_RETURN(run.simulation, context_.lab.WorldOf(world));
    run.visit = history.num_visits;
    run.patience = context_.lab.options().session_timeout;
    run.json_file = folder + "/one_more.json";
    run.trajectory_file = folder + "/one_more.traj";
    run.truth_file = folder + "/one_more.truth";
    MAPP_RETURN_IF_ERROR(context_.lab.options().play_features(run, stop));
    MAPP_ASSIGN_OR_RETURN(outcome.after_one_more, DetectChanges(address, stop));
    return absl::OkStatus();
  }

  Status Score(const FleetFigures& fleet, const sim::SimulationOptions& world, const History& history,
               const std::string& folder, Outcome& outcome) {
    MAPP_ASSIGN_OR_RETURN(const Pose3 T_world_map, FindMapInWorld(fleet));
    TakeToWorld(T_world_map, outcome.scan.changes);
    MAPP_ASSIGN_OR_RETURN(const auto simulation, context_.lab.WorldOf(world));
    auto& features = features_[simulation];
    if (features == nullptr) features = std::make_shared<const sim::FeatureWorld>(simulation->world);
    const std::span<const sim::Visit> visits(simulation->visits.data(), static_cast<size_t>(history.num_visits));
    MAPP_ASSIGN_OR_RETURN(const SortedChanges sorted, SortChanges(features, visits));
    MAPP_ASSIGN_OR_RETURN(const std::vector<TrueChange> changes, TrueChangesOf(*simulation->world, sorted.visible));
    MAPP_ASSIGN_OR_RETURN(const std::vector<TrueChange> others, TrueChangesOf(*simulation->world, sorted.others));
    MAPP_RETURN_IF_ERROR(DropOthers(changes, others, outcome.scan.changes));
    MAPP_ASSIGN_OR_RETURN(outcome.score, ScoreChanges(changes, outcome.scan.changes));
    const std::string title = fmt::format("{}, {}, seed {}", world.setting, history.title, world.seed);
    return WriteLists(title, changes, others, outcome, folder);
  }

  EvalContext& context_;
  const int num_seeds_;
  int num_measured_ = 0;
  std::string setup_;
  std::map<std::shared_ptr<const sim::Simulation>, std::shared_ptr<const sim::FeatureWorld>> features_;
};

/// The median over seeds of those that have the figure.
template <typename Figure>
Cell MedianOver(const std::vector<Outcome>& outcomes, const Figure& figure) {
  std::vector<double> values;
  for (const Outcome& outcome : outcomes) {
    if (const std::optional<double> value = figure(outcome)) values.push_back(*value);
  }
  return Median(values);
}

std::optional<double> CountOf(size_t count) { return static_cast<double>(count); }

std::vector<Cell> ScoreCells(const std::vector<Outcome>& outcomes) {
  const auto count = [&](size_t ChangeCounts::*member) {
    return MedianOver(outcomes, [&](const Outcome& outcome) { return CountOf(outcome.score.all.*member); });
  };
  return {count(&ChangeCounts::num_true),
          count(&ChangeCounts::num_found),
          count(&ChangeCounts::num_detected),
          count(&ChangeCounts::num_right),
          MedianOver(outcomes, [](const Outcome& outcome) { return outcome.score.all.Precision(); }),
          MedianOver(outcomes, [](const Outcome& outcome) { return outcome.score.all.Recall(); }),
          MedianOver(outcomes, [](const Outcome& outcome) { return Mean(outcome.score.right_ious); }),
          MedianOver(outcomes,
                     [](const Outcome& outcome) {
                       return CountOf(static_cast<size_t>(std::ranges::count_if(
                           outcome.score.right_ious, [](double iou) { return iou >= kGoodIou; })));
                     }),
          MedianOver(outcomes, [](const Outcome& outcome) { return std::optional(outcome.scan.seconds); })};
}

std::vector<Column> WithScoreColumns(std::vector<Column> columns) {
  columns.insert(columns.end(), {{"true", 0},
                                 {"found", 0},
                                 {"detected", 0},
                                 {"right", 0},
                                 {"precision", 2},
                                 {"recall", 2},
                                 {"mean IoU", 2},
                                 {"right with IoU 0.3", 0},
                                 {"scan, s", 2}});
  return columns;
}

struct ScoreTables {
  ResultTable medians;
  ResultTable seeds;
  ResultTable times;
};

ScoreTables ChangeTables() {
  ScoreTables tables;
  tables.medians.id = "changes";
  tables.medians.title = "Changes found, medians over the seeds";
  tables.medians.columns = WithScoreColumns({{"setting"}, {"history"}, {"visits", 0}, {"seeds", 0}});
  tables.seeds.id = "changes_seeds";
  tables.seeds.title = "Seed by seed";
  tables.seeds.columns = WithScoreColumns({{"setting"}, {"history"}, {"seed", 0}});
  tables.seeds.columns.insert(tables.seeds.columns.end(), {{"false", 0}, {"twice", 0}, {"wrong kind", 0}});
  tables.times.id = "changes_time";
  tables.times.title = "How long it takes, medians over the seeds";
  tables.times.columns = {{"setting"},
                          {"history"},
                          {"sessions", 0},
                          {"points", 0},
                          {"scan, s", 2},
                          {"rerun, s", 2},
                          {"sessions read after one more", 0},
                          {"with one more, s", 2}};
  return tables;
}

void Append(std::vector<Cell> cells, std::vector<Cell>& row) { row.insert(row.end(), cells.begin(), cells.end()); }

void AddRows(const std::string& setting, const History& history, const std::vector<Outcome>& outcomes,
             uint64_t first_seed, ScoreTables& tables) {
  std::vector<Cell>& medians = tables.medians.rows.emplace_back(
      std::vector<Cell>{setting, history.title, Cell(history.num_visits), Cell(static_cast<double>(outcomes.size()))});
  Append(ScoreCells(outcomes), medians);
  for (size_t i = 0; i < outcomes.size(); ++i) {
    std::vector<Cell>& row = tables.seeds.rows.emplace_back(
        std::vector<Cell>{setting, history.title, Cell(static_cast<double>(first_seed + i))});
    const ChangeScore& score = outcomes[i].score;
    Append(ScoreCells({outcomes[i]}), row);
    Append({CountOf(score.num_false), CountOf(score.num_duplicate), CountOf(score.num_wrong_kind)}, row);
  }
  if (!history.is_timed) return;
  const auto median = [&](const auto& figure) { return MedianOver(outcomes, figure); };
  tables.times.rows.push_back(
      {setting, history.title, median([](const Outcome& outcome) { return CountOf(outcome.num_sessions); }),
       median([](const Outcome& outcome) { return CountOf(outcome.num_points); }),
       median([](const Outcome& outcome) { return std::optional(outcome.scan.seconds); }),
       median([](const Outcome& outcome) { return std::optional(outcome.rerun->seconds); }),
       median([](const Outcome& outcome) { return CountOf(outcome.after_one_more->num_sessions_read); }),
       median([](const Outcome& outcome) { return std::optional(outcome.after_one_more->seconds); })});
}

}  // namespace

StatusOr<ExperimentResult> RunChanges(EvalContext& context) {
  ExperimentResult result;
  ScoreTables tables = ChangeTables();
  Histographer histographer(context);
  std::vector<std::string> settings = context.Chosen({"garage", "hall"});
  if (context.quick()) settings.resize(1);
  for (const std::string& setting : settings) {
    const std::vector<History> histories = Histories(context.quick());
    std::vector<std::vector<Outcome>> outcomes(histories.size());
    for (int i = 0; i < histographer.num_seeds(); ++i) {
      for (size_t h = 0; h < histories.size(); ++h) {
        const uint64_t seed = context.seed + static_cast<uint64_t>(i);
        MAPP_ASSIGN_OR_RETURN(Outcome outcome, histographer.Measure(setting, histories[h], seed));
        outcomes[h].push_back(std::move(outcome));
      }
    }
    for (size_t h = 0; h < histories.size(); ++h) AddRows(setting, histories[h], outcomes[h], context.seed, tables);
    result.setup += histographer.setup() + " ";
  }
  result.setup += fmt::format(
      "{} seeds. Devices come one after the other; changes are within 6 m of a way, or further where too little stands "
      "beside it. ",
      histographer.num_seeds());
  result.tables = {std::move(tables.medians), std::move(tables.seeds), std::move(tables.times)};
  result.paper = "The paper does not look for changes.";
  result.remarks = {
      "True: what changed before the last visit and lay in view of a visit before and of one after, unless a like "
      "thing "
      "took its place between the same two visits. Other changes, and detections of them, are not counted.",
      "A moved thing is found by a detection that it moved, or that one vanished here or appeared there; both of these "
      "are right.",
      "A detection is right when its box and the true one have IoU 0.2, or its centre lies in the true one.",
      fmt::format(
          "Poses wrong: in a copy of the map, each visit's cameras are shifted by up to {:.1f} m and turned by up "
          "to 1 degree where they stand, all of a visit alike.",
          kMaxOffset_m),
      "Scan: all sessions, for the first time. Rerun: the same again. One more: another visit has come."};
  return result;
}

}  // namespace mapp
