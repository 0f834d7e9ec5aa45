#include "cli/compact.h"

#include "cli/admin_client.h"
#include "cli/confirm.h"
#include "cli/progress_bar.h"
#include "cli/text_table.h"
#include "text/json_writer.h"

#include <fmt/format.h>

#include <vector>

namespace mapp {
namespace {

struct CompactedMap {
  std::string name;
  CompactionSummary summary;
};

StatusOr<std::vector<std::string>> MapsToCompact(const CompactOptions& options, AdminClient& client) {
  if (!options.map_name.empty()) return std::vector<std::string>{options.map_name};
  MAPP_ASSIGN_OR_RETURN(const std::vector<MapSummary> maps, client.ListMaps());
  std::vector<std::string> names;
  for (const MapSummary& map : maps) names.push_back(map.name);
  return names;
}

StatusOr<std::vector<CompactedMap>> Compact(const CompactOptions& options, bool dry_run,
                                            const std::vector<std::string>& names, const std::stop_token& stop,
                                            AdminClient& client) {
  std::vector<CompactedMap> compacted;
  for (const std::string& name : names) {
    ProgressBar bar(fmt::format("compact {}", name), 100);
    const auto show = [&bar](const CompactionStep& step) {
      const uint64_t done = step.rows_total == 0 ? 100 : 100 * step.rows_done / step.rows_total;
      bar.Update(done, fmt::format("{} of {} rows, {} to give back", step.rows_done, step.rows_total,
                                   FormatBytes(static_cast<double>(step.bytes_left))));
    };
    const bool rewrite = options.rewrite && &name == &names.back();
    const CompactionOrder order{name, options.keep_revisions, options.keep_days, dry_run, rewrite};
    MAPP_ASSIGN_OR_RETURN(CompactionSummary summary, client.CompactMap(order, show, stop));
    compacted.push_back({name, std::move(summary)});
  }
  return compacted;
}

std::string FormatJson(const std::vector<CompactedMap>& maps, bool dry_run) {
  JsonWriter json;
  json.BeginObject().Field("dry_run", dry_run).Key("maps").BeginArray();
  for (const CompactedMap& map : maps) {
    json.BeginObject().Field("name", map.name).Field("oldest_revision_before", map.summary.oldest_before);
    json.Field("oldest_revision", map.summary.oldest).Field("kept_for_tag", map.summary.kept_for_tag);
    json.Field("num_rows", map.summary.num_rows);
    json.Field("num_bytes_given_back", map.summary.num_bytes_given_back).EndObject();
  }
  json.EndArray().EndObject();
  return std::move(json).Finish();
}

std::string FormatText(const std::vector<CompactedMap>& maps, bool dry_run) {
  TextTable table({{"map"},
                   {"oldest revision", Align::kRight},
                   {"rows", Align::kRight},
                   {dry_run ? "" : "given back", Align::kRight},
                   {"kept for tag"}});
  for (const CompactedMap& map : maps) {
    const CompactionSummary& summary = map.summary;
    table.AddRow({map.name, fmt::format("{} -> {}", summary.oldest_before, summary.oldest),
                  std::to_string(summary.num_rows),
                  dry_run ? "" : FormatBytes(static_cast<double>(summary.num_bytes_given_back)), summary.kept_for_tag});
  }
  return table.Format();
}

}  // namespace

Status RunCompact(const CompactOptions& options, const std::stop_token& stop, std::istream& in, std::ostream& out) {
  if (!options.keep_revisions && !options.keep_days) {
    return absl::InvalidArgumentError("say what to keep: --keep-revisions, --keep-days or both");
  }
  AdminClient client(options.server);
  MAPP_ASSIGN_OR_RETURN(const std::vector<std::string> names, MapsToCompact(options, client));
  MAPP_ASSIGN_OR_RETURN(std::vector<CompactedMap> maps, Compact(options, /*dry_run=*/true, names, stop, client));
  if (!options.dry_run) {
    uint64_t num_rows = 0;
    for (const CompactedMap& map : maps) num_rows += map.summary.num_rows;
    if (!options.json && !options.yes) out << FormatText(maps, /*dry_run=*/true);
    const Question question{
        .text = fmt::format("Drop {} rows of history of {} maps? Revisions before those kept cannot be read any more.",
                            num_rows, maps.size()),
        .doing = "dropping history",
        .not_done = "nothing was dropped",
        .yes = options.yes,
        .interactive = options.interactive};
    MAPP_RETURN_IF_ERROR(Confirm(question, in, out));
    StatusOr<std::vector<CompactedMap>> done = Compact(options, /*dry_run=*/false, names, stop, client);
    if (absl::IsCancelled(done.status()) && stop.stop_requested()) {
      return absl::CancelledError("interrupted: the same command goes on with what is left");
    }
    MAPP_ASSIGN_OR_RETURN(maps, std::move(done));
  }
  out << (options.json ? FormatJson(maps, options.dry_run) : FormatText(maps, options.dry_run));
  return absl::OkStatus();
}

}  // namespace mapp
