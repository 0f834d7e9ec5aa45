#include "cli/server_info.h"

#include "cli/admin_client.h"
#include "cli/text_table.h"
#include "text/json_writer.h"

#include <fmt/format.h>

namespace mapp {
namespace {

void WriteTimes(const LatencySummary& latency, JsonWriter& json) {
  json.Field("mean_ms", latency.mean_ms).Field("median_ms", latency.p50_ms).Field("p95_ms", latency.p95_ms);
}

std::string FormatJson(const ServerSummary& server) {
  JsonWriter json;
  json.BeginObject().Field("version", server.version).Field("schema_version", server.schema_version);
  json.Field("started_unix_ns", server.started_unix_ns).Field("cpu_s", server.usage.cpu_s);
  json.Field("rss_bytes", server.usage.rss_bytes).Field("peak_rss_bytes", server.usage.peak_rss_bytes);
  json.Key("methods").BeginArray();
  for (const MethodSummary& method : server.methods) {
    json.BeginObject().Field("method", method.method);
    json.Field("num_calls", method.latency.count).Field("num_errors", method.num_errors);
    WriteTimes(method.latency, json);
    json.EndObject();
  }
  json.EndArray().Key("steps").BeginArray();
  for (const StepSummary& step : server.steps) {
    json.BeginObject().Field("step", step.step).Field("num_runs", step.latency.count);
    WriteTimes(step.latency, json);
    json.EndObject();
  }
  json.EndArray().EndObject();
  return std::move(json).Finish();
}

std::vector<std::string> Row(const std::string& name, const LatencySummary& latency, const std::string& errors) {
  return {name,
          std::to_string(latency.count),
          errors,
          fmt::format("{:.3f}", latency.mean_ms),
          fmt::format("{:.3f}", latency.p50_ms),
          fmt::format("{:.3f}", latency.p95_ms)};
}

std::string FormatText(const ServerSummary& server) {
  constexpr double kMegabyte = 1e6;
  std::string text = fmt::format("mapp-server {}, schema {}, up since {} UTC\n", server.version, server.schema_version,
                                 FormatUnixTime(server.started_unix_ns));
  text += fmt::format("CPU {:.1f} s, memory {:.0f} MB, at most {:.0f} MB\n", server.usage.cpu_s,
                      static_cast<double>(server.usage.rss_bytes) / kMegabyte,
                      static_cast<double>(server.usage.peak_rss_bytes) / kMegabyte);
  TextTable table({{"method or step"},
                   {"runs", Align::kRight},
                   {"errors", Align::kRight},
                   {"mean ms", Align::kRight},
                   {"median ms", Align::kRight},
                   {"p95 ms", Align::kRight}});
  for (const MethodSummary& method : server.methods) {
    table.AddRow(Row(method.method, method.latency, std::to_string(method.num_errors)));
  }
  for (const StepSummary& step : server.steps) table.AddRow(Row(step.step, step.latency, "-"));
  return text + table.Format();
}

}  // namespace

Status RunServerInfo(const ServerInfoOptions& options, std::ostream& out) {
  MAPP_ASSIGN_OR_RETURN(const ServerSummary server, AdminClient(options.server).GetServerInfo());
  out << (options.json ? FormatJson(server) : FormatText(server));
  return absl::OkStatus();
}

}  // namespace mapp
