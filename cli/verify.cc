#include "cli/verify.h"

#include "cli/progress_bar.h"
#include "storage/verify.h"
#include "text/json_writer.h"
#include "vision/place_block.h"

#include <fmt/format.h>

namespace mapp {
namespace {

StatusOr<VerifyReport> VerifyFromHere(const std::string& database, const std::stop_token& stop) {
  CallContext context;
  context.is_cancelled = [stop] { return stop.stop_requested(); };
  ProgressBar bar("verify, %", 100);
  VerifyOptions options;
  options.check_place_block = [](std::string_view block) { return DecodePlaceBlock(block).status(); };
  options.on_progress = [&bar](const VerifyProgress& progress) {
    bar.Update(static_cast<size_t>(100 * progress.num_done / progress.num_checks), progress.check);
  };
  StatusOr<VerifyReport> report = VerifyDatabase(context, database, options);
  if (absl::IsCancelled(report.status()) && stop.stop_requested()) {
    return absl::CancelledError("interrupted: not all was checked");
  }
  return report;
}

std::string FormatJson(const std::string& database, const VerifyReport& report) {
  JsonWriter json;
  json.BeginObject().Field("db", database).Field("num_violations", report.num_violations());
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
  MAPP_ASSIGN_OR_RETURN(const VerifyReport report, VerifyFromHere(options.database, stop));
  out << (options.json ? FormatJson(options.database, report) : FormatText(options.database, report)) << std::flush;
  if (report.num_violations() == 0) return absl::OkStatus();
  return absl::DataLossError(fmt::format("{}: {} violations; restore a backup, or see docs/operations.md",
                                         options.database, report.num_violations()));
}

}  // namespace mapp
