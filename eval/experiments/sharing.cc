// Devices that travel where the map is known: what sharing saves them, what it costs in traffic, and how far ahead a
// shared map should reach. Medians over worlds of several seeds.

#include "eval/experiments/experiment.h"
#include "eval/experiments/scenarios.h"
#include "eval/metrics/statistics.h"

#include <fmt/format.h>

#include <algorithm>
#include <span>

namespace mapp {
namespace {

/// A way of using a known map.
struct Manner {
  std::string title;
  std::string policy;
  int num_drives = 1;   ///< one after the other on the same way
  bool cached = false;  ///< with one cache of tiles for all drives
};

const char* const kMapping = "no_sharing";

/// The first user maps a way, the others walk it again, at their own pace.
FleetSpec DrivesAgain(const EvalContext& context, const std::string& setting, double path_m, const Manner& manner,
                      uint64_t seed) {
  constexpr int kMaxDrives = 2;
  sim::SimulationOptions world = SettingWorld(context, setting, 1 + kMaxDrives);
  world.num_routes = 1;
  world.path_m = path_m;
  world.seed = seed;
  FleetSpec spec = FleetOf(world, Level::kRendered, "depth_sketch");
  spec.devices.resize(static_cast<size_t>(1 + manner.num_drives));
  for (size_t i = 1; i < spec.devices.size(); ++i) {
    spec.devices[i].policy = manner.policy;
    if (manner.cached) spec.devices[i].tile_cache = "device";
  }
  return spec;
}

/// What a device's report says, and what follows from it.
std::optional<double> FigureOf(const Figures& report, const std::string& name) {
  if (name == "device_cpu_ms") return Ratio(1e3 * report.Get("cpu_s.device").value_or(0), *report.Get("frames"));
  if (name == "slam_cpu_ms") {
    // Without the extraction of features, which every frame needs wherever its pose comes from.
    const double cpu_s = report.Get("cpu_s.tracking").value_or(0) + report.Get("cpu_s.localization").value_or(0) +
                         report.Get("cpu_s.local_mapping").value_or(0) - report.Get("cpu_s.extraction").value_or(0);
    return Ratio(1e3 * cpu_s, *report.Get("frames"));
  }
  if (name == "shared_share") return Percent(report.Get("frames_on_shared_map"), report.Get("frames"));
  if (name == "traffic_kb") {
    const double bytes = report.Get("traffic.shared_map.bytes_per_keyframe").value_or(0) +
                         report.Get("traffic.shared_map_request.bytes_per_keyframe").value_or(0);
    return bytes * 1e-3;
  }
  return report.Get(name);
}

/// The same drive of every seed.
using Drives = std::vector<const Figures*>;

Cell MedianOf(const Drives& drives, const std::string& name) {
  std::vector<double> values;
  for (const Figures* report : drives) {
    if (const auto value = FigureOf(*report, name)) values.push_back(*value);
  }
  return Median(values);
}

/// By how much less than what the same seed's device took that mapped for itself, in percent.
Cell MedianSaved(const Drives& drives, const Drives& mapping, const std::string& name) {
  std::vector<double> values;
  for (size_t i = 0; i < drives.size(); ++i) {
    const auto share = Percent(FigureOf(*drives[i], name), FigureOf(*mapping[i], name));
    if (share) values.push_back(100 - *share);
  }
  return Median(values);
}

/// All manners in one setting: rows of a table, `mapping` for itself being the first.
class Comparison {
 public:
  Comparison(EvalContext& context, std::string setting, double path_m)
      : context_(context), setting_(std::move(setting)), path_m_(path_m), num_seeds_(context.quick() ? 1 : 3) {}

  Status Measure(const Manner& manner, ResultTable& table) {
    std::vector<Drives> drives(static_cast<size_t>(manner.num_drives));
    for (int i = 0; i < num_seeds_; ++i) {
      const FleetSpec spec = DrivesAgain(context_, setting_, path_m_, manner, context_.seed + static_cast<uint64_t>(i));
      setup_ = Describe(spec);
      MAPP_ASSIGN_OR_RETURN(const auto fleet, context_.lab.Run(spec));
      kept_.push_back(fleet);
      for (size_t drive = 0; drive < drives.size(); ++drive) {
        drives[drive].push_back(&fleet->devices[1 + drive].report);
      }
    }
    if (mapping_.empty()) mapping_ = drives[0];
    for (size_t drive = 0; drive < drives.size(); ++drive) {
      const std::string which = drives.size() == 1 ? "" : fmt::format(", drive {}", drive + 1);
      table.rows.push_back(Row(manner.title + which, drives[drive]));
    }
    return absl::OkStatus();
  }
  std::string setup() const { return fmt::format("{} {} seeds. ", setup_, num_seeds_); }

 private:
  std::vector<Cell> Row(const std::string& title, const Drives& drives) const {
    const auto median = [&drives](const char* name) { return MedianOf(drives, name); };
    return {setting_,
            title,
            median("shared_share"),
            median("device_cpu_ms"),
            MedianSaved(drives, mapping_, "device_cpu_ms"),
            median("slam_cpu_ms"),
            MedianSaved(drives, mapping_, "slam_cpu_ms"),
            median("ate_m"),
            median("ate_joint_m"),
            median("traffic_kb"),
            median("shared_map_requests"),
            median("cached_tiles"),
            median("latency_ms.first_shared_tile.p95"),
            median("latency_ms.shared_map_request.p95")};
  }

  EvalContext& context_;
  const std::string setting_;
  const double path_m_;
  const int num_seeds_;
  std::string setup_;
  Drives mapping_;
  std::vector<std::shared_ptr<const FleetFigures>> kept_;
};

ResultTable SharingTable(const std::string& id, const std::string& title) {
  ResultTable table;
  table.id = id;
  table.title = title;
  table.columns = {{"setting"},
                   {"device"},
                   {"frames on shared map, %", 0},
                   {"device CPU, ms/frame", 2},
                   {"saved, %", 0},
                   {"localization and mapping CPU, ms/frame", 2},
                   {"saved there, %", 0},
                   {"ATE, m", 4},
                   {"joint ATE, m", 4},
                   {"shared map, KB/keyframe", 2},
                   {"requests", 1},
                   {"cached tiles", 0},
                   {"first tile, ms (p95)", 1},
                   {"whole map, ms (p95)", 1}};
  return table;
}

Status AddRows(EvalContext& context, const std::vector<std::string>& settings, double path_m,
               std::span<const Manner> manners, ExperimentResult& result, ResultTable table) {
  for (const std::string& setting : settings) {
    Comparison comparison(context, setting, path_m);
    for (const Manner& manner : manners) MAPP_RETURN_IF_ERROR(comparison.Measure(manner, table));
    result.setup += comparison.setup();
  }
  result.setup +=
      "The first user maps a way; who comes after walks it again, on a map of the first alone. Figures are theirs, "
      "medians over the seeds. ";
  result.tables.push_back(std::move(table));
  return absl::OkStatus();
}

}  // namespace

StatusOr<ExperimentResult> RunSharing(EvalContext& context) {
  const std::vector<Manner> manners = {
      {"mapping for itself", kMapping},
      {"look-ahead 10 m, tile cache", "look_ahead_10", /*num_drives=*/2, /*cached=*/true}};
  std::vector<std::string> settings = context.Chosen({"garage", "plaza"});
  if (context.quick()) settings.resize(1);
  ExperimentResult result;
  MAPP_RETURN_IF_ERROR(AddRows(context, settings, context.quick() ? 30 : 65, manners, result,
                               SharingTable("sharing", "Devices where the map is known, with and without sharing")));
  result.paper =
      "Sharing lowers the device's CPU by 48 % in all and by 72 % for localization; ATE 0.175 to 0.128 m (garage) and "
      "0.308 to 0.280 m (plaza); 25 and 24 KB of shared map a keyframe.";
  result.remarks = {
      "Device CPU leaves out the drawing of frames. Power was not measured; CPU seconds stand in for it.",
      "Localization and mapping: tracking, localization and local mapping without the extraction of features, which is "
      "the same wherever a pose comes from.",
      "Shared map: tiles, summaries and requests, per keyframe that the device made or would have made.",
      "Drive 1 begins with an empty cache. What changed between the drives is what drive 1 brought and what its "
      "optimization moved."};
  return result;
}

StatusOr<ExperimentResult> RunAlpha(EvalContext& context) {
  const std::vector<Manner> manners = {{"mapping for itself", kMapping},
                                       {"alpha 1", "alpha_1"},
                                       {"alpha 1.3", "alpha_1.3"},
                                       {"look-ahead 10 m", "look_ahead_10"},
                                       {"look-ahead 20 m", "look_ahead_20"}};
  ExperimentResult result;
  MAPP_RETURN_IF_ERROR(AddRows(context, {"garage"}, 22, manners, result,
                               SharingTable("alpha", "How far a shared map reaches: alpha 1, 1.3, and look-ahead")));
  result.paper = "On a way of 22 m, 3 requests with alpha = 1 and 2 with alpha = 1.3.";
  result.remarks = {
      "Look-ahead: alpha 1.3, then the tiles that come into view so far along the way, straight on and "
      "where the first user went on from there (docs/decisions/0019)."};
  return result;
}

}  // namespace mapp
