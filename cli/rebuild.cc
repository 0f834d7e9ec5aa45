#include "cli/rebuild.h"

#include "cli/progress_bar.h"
#include "cli/text_table.h"
#include "server/rebuild/rebuild.h"
#include "text/json_writer.h"

#include <fmt/format.h>
#include <fmt/ranges.h>

#include <optional>
#include <utility>

namespace mapp {
namespace {

void AppendStrings(const char* key, const std::vector<std::string>& strings, JsonWriter& json) {
  json.Key(key).BeginArray();
  for (const std::string& string : strings) json.Value(string);
  json.EndArray();
}

std::string FormatJson(const RebuildReport& report) {
  JsonWriter json;
  json.BeginObject().Field("num_keyframes", report.num_keyframes).Key("maps").BeginArray();
  for (const RebuiltMap& map : report.maps) {
    json.BeginObject().Field("name", map.name).Field("num_frames_before", map.num_frames_before);
    json.Field("num_frames", map.num_frames).Field("num_points_before", map.num_points_before);
    json.Field("num_points", map.num_points).Field("median_moved_m", map.median_moved_m);
    json.Field("max_moved_m", map.max_moved_m);
    AppendStrings("dropped_tags", map.dropped_tags, json);
    json.EndObject();
  }
  json.EndArray();
  AppendStrings("problems", report.problems, json);
  json.EndObject();
  return std::move(json).Finish();
}

std::string FormatText(const RebuildReport& report) {
  TextTable table({{"map"},
                   {"frames", Align::kRight},
                   {"points", Align::kRight},
                   {"moved, median", Align::kRight},
                   {"moved, most", Align::kRight},
                   {"tags dropped"}});
  for (const RebuiltMap& map : report.maps) {
    table.AddRow({map.name, fmt::format("{} -> {}", map.num_frames_before, map.num_frames),
                  fmt::format("{} -> {}", map.num_points_before, map.num_points),
                  fmt::format("{:.4f} m", map.median_moved_m), fmt::format("{:.4f} m", map.max_moved_m),
                  fmt::format("{}", fmt::join(map.dropped_tags, ", "))});
  }
  std::string text = table.Format();
  for (const std::string& problem : report.problems) text += problem + "\n";
  return text;
}

}  // namespace

Status RunRebuild(const RebuildCommandOptions& options, const std::stop_token& stop, std::ostream& out) {
  CallContext context;
  context.is_cancelled = [stop] { return stop.stop_requested(); };
  std::optional<ProgressBar> bar;
  RebuildOptions rebuild;
  rebuild.num_threads = options.num_threads;
  rebuild.on_progress = [&bar](const RebuildProgress& progress) {
    if (!bar) bar.emplace("rebuild", static_cast<size_t>(progress.num_keyframes));
    bar->Update(static_cast<size_t>(progress.num_done),
                fmt::format("{} of {} keyframes", progress.num_done, progress.num_keyframes));
  };
  const StatusOr<RebuildReport> report = RebuildDatabase(context, options.database, options.to, rebuild);
  bar.reset();
  if (absl::IsCancelled(report.status()) && stop.stop_requested()) {
    return absl::CancelledError("interrupted: nothing was written");
  }
  MAPP_RETURN_IF_ERROR(report.status());
  out << (options.json ? FormatJson(*report) : FormatText(*report)) << std::flush;
  if (report->problems.empty()) return absl::OkStatus();
  return absl::DataLossError(
      fmt::format("{}: written, but {} problems are listed above", options.to, report->problems.size()));
}

}  // namespace mapp
