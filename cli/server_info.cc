#include "cli/server_info.h"

#include "cli/admin_client.h"
#include "cli/text_table.h"
#include "text/json_writer.h"

#include <fmt/format.h>

namespace mapp {
namespace {

std::string FormatJson(const ServerSummary& server) {
  JsonWriter json;
  json.BeginObject().Field("version", server.version).Field("schema_version", server.schema_version);
  json.Field("started_unix_ns", server.started_unix_ns).Key("methods").BeginArray();
  for (const MethodSummary& method : server.methods) {
    json.BeginObject().Field("method", method.method);
    json.Field("num_calls", method.num_calls).Field("num_errors", method.num_errors);
    json.Field("median_ms", method.median_ms).Field("p95_ms", method.p95_ms).EndObject();
  }
  json.EndArray().EndObject();
  return std::move(json).Finish();
}

std::string FormatText(const ServerSummary& server) {
  std::string text = fmt::format("mapp-server {}, schema {}, up since {} UTC\n", server.version, server.schema_version,
                                 FormatUnixTime(server.started_unix_ns));
  TextTable table({{"method"},
                   {"calls", Align::kRight},
                   {"errors", Align::kRight},
                   {"median ms", Align::kRight},
                   {"p95 ms", Align::kRight}});
  for (const MethodSummary& method : server.methods) {
    table.AddRow({method.method, std::to_string(method.num_calls), std::to_string(method.num_errors),
                  fmt::format("{:.3f}", method.median_ms), fmt::format("{:.3f}", method.p95_ms)});
  }
  return text + table.Format();
}

}  // namespace

Status RunServerInfo(const ServerInfoOptions& options, std::ostream& out) {
  MAPP_ASSIGN_OR_RETURN(const ServerSummary server, AdminClient(options.server).GetServerInfo());
  out << (options.json ? FormatJson(server) : FormatText(server));
  return absl::OkStatus();
}

}  // namespace mapp
