#include "cli/changes.h"

#include "cli/admin_client.h"
#include "cli/change_export.h"
#include "cli/change_image.h"
#include "cli/change_text.h"
#include "cli/changed_map.h"
#include "cli/progress_bar.h"
#include "text/file_io.h"
#include "text/json_writer.h"

#include <fmt/format.h>
#include <fmt/ranges.h>

#include <algorithm>
#include <utility>

namespace mapp {
namespace {

StatusOr<ChangeSummary> FindChange(const std::string& map_name, uint64_t id, AdminClient& client) {
  MAPP_ASSIGN_OR_RETURN(std::vector<ChangeSummary> changes, client.ListChanges(map_name));
  const auto found = std::ranges::find(changes, id, &ChangeSummary::id);
  if (found == changes.end()) return absl::NotFoundError(fmt::format("map {} has no change {}", map_name, id));
  return std::move(*found);
}

/// The one asked for, or all that an operator has not called wrong.
StatusOr<std::vector<ChangeSummary>> ChangesToShow(const std::string& map_name, std::optional<uint64_t> id,
                                                   AdminClient& client) {
  if (id) {
    MAPP_ASSIGN_OR_RETURN(ChangeSummary change, FindChange(map_name, *id, client));
    return std::vector{std::move(change)};
  }
  MAPP_ASSIGN_OR_RETURN(std::vector<ChangeSummary> changes, client.ListChanges(map_name));
  std::erase_if(changes, [](const ChangeSummary& change) { return change.status == ChangeStatus::kRejected; });
  return changes;
}

/// What a file that was written holds.
void ReportFile(const std::string& file, const MapContent& map, size_t num_changes, size_t num_lost, bool as_json,
                std::ostream& out) {
  if (as_json) {
    JsonWriter json;
    json.BeginObject().Field("map", map.map.name).Field("revision", map.map.revision).Field("file", file);
    json.Field("num_changes", num_changes).Field("num_points", map.points.size());
    json.Field("num_points_compacted_away", num_lost).EndObject();
    out << std::move(json).Finish();
    return;
  }
  out << fmt::format("{}: {} changes of map {} at revision {}\n", file, num_changes, map.map.name, map.map.revision);
  if (num_lost > 0) out << fmt::format("without {} points of them that are compacted away\n", num_lost);
}

std::string FormatDetection(const std::string& map_name, const ChangeDetectionSummary& found) {
  const std::string table = found.changes.empty() ? std::string() : FormatChangeTable(found.changes);
  return table + fmt::format("{}: {} changes: {} new, {} accepted; {} dropped; {} of {} sessions read, {:.1f} s\n",
                             map_name, found.changes.size(), found.num_new, found.num_accepted, found.num_dropped,
                             found.num_sessions_read, found.num_sessions, found.seconds);
}

std::string FormatDetectionJson(const std::string& map_name, const ChangeDetectionSummary& found) {
  JsonWriter json;
  json.BeginObject().Field("map", map_name);
  AppendChanges(found.changes, json);
  json.Field("num_new", found.num_new).Field("num_dropped", found.num_dropped);
  json.Field("num_accepted", found.num_accepted).Field("num_sessions_read", found.num_sessions_read);
  json.Field("num_sessions", found.num_sessions).Field("seconds", found.seconds).EndObject();
  return std::move(json).Finish();
}

StatusOr<ChangeDecisionSummary> Decide(const ChangesDecideOptions& options) {
  AdminClient client(options.server);
  switch (options.decision) {
    case ChangeDecision::kAccept:
      return client.AcceptChanges(options.map_name, options.ids);
    case ChangeDecision::kReject:
      return client.RejectChanges(options.map_name, options.ids);
    case ChangeDecision::kUndo:
      return client.UndoChanges(options.map_name, options.ids);
  }
  return absl::InternalError("a decision of no kind");
}

std::string FormatDecision(const ChangesDecideOptions& options, const ChangeDecisionSummary& done) {
  const bool undo = options.decision == ChangeDecision::kUndo;
  std::string text = undo ? "proposed again" : options.decision == ChangeDecision::kAccept ? "accepted" : "rejected";
  std::vector<uint64_t> ids;
  for (const ChangeSummary& change : done.changes) ids.push_back(change.id);
  text += fmt::format(": {} {}; ", ids.size() == 1 ? "change" : "changes", fmt::join(ids, " "));
  text += done.map_revision == 0 ? std::string("the map stays as it was\n")
                                 : fmt::format("{} points {} at revision {}\n", done.num_points,
                                               undo ? "live again" : "retired", done.map_revision);
  if (!undo)
    text += fmt::format("`mapp changes undo --map {} {}` takes it back\n", options.map_name, fmt::join(ids, " "));
  return text;
}

}  // namespace

Status RunChangesDetect(const ChangesDetectOptions& options, const std::stop_token& stop, std::ostream& out) {
  StatusOr<ChangeDetectionSummary> found;
  {
    constexpr size_t kPercent = 100;  // how many sessions there are is known when the server has begun
    ProgressBar bar(fmt::format("changes of {}", options.order.map_name), kPercent);
    const auto show = [&bar](const ChangeDetectionStep& step) {
      bar.Update(step.num_sessions == 0 ? 0 : kPercent * step.num_sessions_done / step.num_sessions,
                 fmt::format("{} of {} sessions", step.num_sessions_done, step.num_sessions));
    };
    found = AdminClient(options.server).DetectChanges(options.order, show, stop);
  }
  if (absl::IsCancelled(found.status()) && stop.stop_requested()) {
    return absl::CancelledError("interrupted: the same command goes on with the sessions that are left");
  }
  MAPP_RETURN_IF_ERROR(found.status());
  out << (options.json ? FormatDetectionJson(options.order.map_name, *found)
                       : FormatDetection(options.order.map_name, *found));
  return absl::OkStatus();
}

Status RunChangesList(const ChangesListOptions& options, std::ostream& out) {
  MAPP_ASSIGN_OR_RETURN(std::vector<ChangeSummary> changes, AdminClient(options.server).ListChanges(options.map_name));
  std::erase_if(changes, [&](const ChangeSummary& change) {
    return change.status != options.status.value_or(change.status) || change.kind != options.kind.value_or(change.kind);
  });
  if (!options.json) {
    out << FormatChangeTable(changes);
    return absl::OkStatus();
  }
  JsonWriter json;
  json.BeginObject().Field("map", options.map_name);
  AppendChanges(changes, json);
  json.EndObject();
  out << std::move(json).Finish();
  return absl::OkStatus();
}

Status RunChangesShow(const ChangesShowOptions& options, std::ostream& out) {
  AdminClient client(options.server);
  MAPP_ASSIGN_OR_RETURN(const ChangeSummary change, FindChange(options.map_name, options.id, client));
  if (!options.json) {
    out << FormatChange(change);
    return absl::OkStatus();
  }
  JsonWriter json;
  AppendChange(change, json);
  out << std::move(json).Finish();
  return absl::OkStatus();
}

Status RunChangesRender(const ChangesRenderOptions& options, std::ostream& out) {
  MAPP_RETURN_IF_ERROR(Annotate(CheckPngName(options.out_file), "--out"));
  AdminClient client(options.server);
  MAPP_ASSIGN_OR_RETURN(std::vector<ChangeSummary> changes, ChangesToShow(options.map_name, options.change_id, client));
  MAPP_ASSIGN_OR_RETURN(const ChangedMap map, FetchChangedMap(options.map_name, std::move(changes), client));
  const bool before_after = options.before_after || options.change_id;
  MAPP_ASSIGN_OR_RETURN(const std::string png,
                        before_after ? DrawBeforeAndAfter(map, options.image) : DrawChanges(map, options.image));
  MAPP_RETURN_IF_ERROR(WriteOutput(options.out_file, png, out));
  // Standard output then carries the picture itself.
  if (options.out_file == "-") return absl::OkStatus();
  ReportFile(options.out_file, map.now, map.changes.size(), map.num_lost, options.json, out);
  return absl::OkStatus();
}

Status RunChangesExport(const ChangesExportOptions& options, std::ostream& out) {
  StatusOr<ChangeExportFormat> format = ChangeExportFormatOf(options.out_file);
  if (!format.ok()) return Annotate(format.status(), "--out");
  AdminClient client(options.server);
  if (*format == ChangeExportFormat::kJson) {
    MAPP_ASSIGN_OR_RETURN(const std::vector<ChangeSummary> changes, client.ListChanges(options.map_name));
    MAPP_ASSIGN_OR_RETURN(const MapContent map, client.ExportMap(options.map_name));
    MAPP_RETURN_IF_ERROR(WriteOutput(options.out_file, FormatChangeFeatures(map, changes), out));
    ReportFile(options.out_file, map, changes.size(), /*num_lost=*/0, options.json, out);
    return absl::OkStatus();
  }
  MAPP_ASSIGN_OR_RETURN(std::vector<ChangeSummary> changes, ChangesToShow(options.map_name, std::nullopt, client));
  MAPP_ASSIGN_OR_RETURN(const ChangedMap map, FetchChangedMap(options.map_name, std::move(changes), client));
  MAPP_RETURN_IF_ERROR(WriteOutput(options.out_file, FormatChangedPly(map), out));
  ReportFile(options.out_file, map.now, map.changes.size(), map.num_lost, options.json, out);
  return absl::OkStatus();
}

Status RunChangesDecide(const ChangesDecideOptions& options, std::ostream& out) {
  MAPP_ASSIGN_OR_RETURN(const ChangeDecisionSummary done, Decide(options));
  if (!options.json) {
    out << FormatDecision(options, done);
    return absl::OkStatus();
  }
  JsonWriter json;
  json.BeginObject().Field("map", options.map_name).Field("map_revision", done.map_revision);
  json.Field("num_points", done.num_points);
  AppendChanges(done.changes, json);
  json.EndObject();
  out << std::move(json).Finish();
  return absl::OkStatus();
}

}  // namespace mapp
