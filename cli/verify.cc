#include "cli/verify.h"

#include "cli/admin_client.h"
#include "cli/progress_bar.h"
#include "storage/verify.h"
#include "text/json_writer.h"
#include "vision/place_block.h"

#include <fmt/format.h>

#include <algorithm>
#include <functional>

namespace mapp {
namespace {

using Observer = std::function<void(const VerifyProgress&)>;

StatusOr<VerifyReport> VerifyFromHere(const std::string& database, const Observer& show, const std::stop_token& stop) {
  CallContext context;
  context.is_cancelled = [stop] { return stop.stop_requested(); };
  VerifyOptions options;
  options.check_place_block = [](std::string_view block) { return DecodePlaceBlock(block).status(); };
  options.on_progress = show;
  return VerifyDatabase(context, database, options);
}

StatusOr<VerifyReport> Verify(const VerifyCommandOptions& options, const std::stop_token& stop) {
  ProgressBar bar("verify, %", 100);
  const Observer show = [&bar](const VerifyProgress& progress) {
    const int percent = 100 * progress.num_done / std::max(progress.num_checks, 1);
    bar.Update(static_cast<size_t>(percent), progress.check);
  };
  StatusOr<VerifyReport> report = options.database.empty() ? AdminClient(options.server).Verify(show, stop)
                                                           : VerifyFromHere(options.database, show, stop);
  if (absl::IsCancelled(report.status()) && stop.stop_requested()) {
    return absl::CancelledError("interrupted: not all was checked");
  }
  return report;
}

std::string FormatJson(const std::string& database, const VerifyReport& report) {
  JsonWriter json;
  json.BeginObject().Field("database", database).Field("num_violations", report.num_violations());
  json.Field("num_maps", report.num_maps).Field("num_keyframes", report.num_keyframes);
  json.Field("num_points", report.num_points).Key("violations").BeginArray();
  for (const Violation& violation : report.violations) {
    json.BeginObject().Field("check", violation.check).Field("what", violation.what).Key("id");
    if (violation.id) {
      json.Value(*violation.id);
    } else {
      json.Null();
    }
    json.Field("message", violation.message).EndObject();
  }
  json.EndArray().Key("unlisted").BeginArray();
  for (const UnlistedViolations& more : report.unlisted) {
    json.BeginObject().Field("check", more.check).Field("count", more.count).EndObject();
  }
  json.EndArray().EndObject();
  return std::move(json).Finish();
}

std::string FormatText(const std::string& database, const VerifyReport& report) {
  std::string text;
  for (const Violation& violation : report.violations) {
    const std::string id = violation.id ? fmt::format(" {}", *violation.id) : std::string();
    text += fmt::format("{}: {}{}: {}\n", violation.check, violation.what, id, violation.message);
  }
  for (const UnlistedViolations& more : report.unlisted) text += fmt::format("{}: {} more\n", more.check, more.count);
  if (report.num_violations() > 0) return text;
  return fmt::format("{}: nothing is wrong; {} maps, {} keyframes, {} points\n", database, report.num_maps,
                     report.num_keyframes, report.num_points);
}

}  // namespace

Status RunVerify(const VerifyCommandOptions& options, const std::stop_token& stop, std::ostream& out) {
  MAPP_ASSIGN_OR_RETURN(const VerifyReport report, Verify(options, stop));
  const std::string& name = options.database.empty() ? options.server : options.database;
  out << (options.json ? FormatJson(name, report) : FormatText(name, report)) << std::flush;
  if (report.num_violations() == 0) return absl::OkStatus();
  return absl::DataLossError(
      fmt::format("{}: {} violations; restore a backup, or see docs/operations.md", name, report.num_violations()));
}

}  // namespace mapp
