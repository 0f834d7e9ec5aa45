#include "cli/replay_report.h"

#include "cli/text_table.h"
#include "eval/metrics/statistics.h"
#include "text/json_writer.h"

#include <fmt/format.h>

#include <algorithm>
#include <utility>

namespace mapp {
namespace {

std::string Percent(std::optional<double> ratio) { return ratio ? fmt::format("{:.1f} %", 100 * *ratio) : "-"; }
std::string Meters(std::optional<double> meters) { return meters ? fmt::format("{:.4f} m", *meters) : "-"; }
std::string Bytes(std::optional<double> bytes) { return bytes ? fmt::format("{:.0f}", *bytes) : "-"; }

uint64_t NumMoments(const ReplayReport& report) { return report.keyframes + report.keyframe_equivalents; }

using NamedMessages = std::pair<const char*, MessageFigures>;
std::vector<NamedMessages> ByName(const ReplayTraffic& traffic) {
  return {{"query", traffic.query},           {"response", traffic.response},
          {"upload", traffic.upload},         {"shared_map_request", traffic.shared_map_request},
          {"shared_map", traffic.shared_map}, {"update_report", traffic.update_report},
          {"evidence", traffic.evidence}};
}

using NamedLatency = std::pair<const char*, LatencySummary>;
std::vector<NamedLatency> ByName(const ReplayLatency& latency) {
  return {{"overlap_assessment", latency.participant.overlap_assessment},
          {"redundancy_control", latency.participant.redundancy_control},
          {"keyframe_upload", latency.participant.keyframe_upload},
          {"shared_map_request", latency.participant.shared_map},
          {"first_shared_tile", latency.participant.first_shared_tile},
          {"update_report", latency.participant.update_report},
          {"localization", latency.localization},
          {"tracking", latency.tracking},
          {"local_mapping", latency.local_mapping}};
}

void WriteTraffic(const ReplayReport& report, JsonWriter& json) {
  json.Key("traffic").BeginObject();
  for (const auto& [name, messages] : ByName(report.traffic)) {
    json.Key(name).BeginObject().Field("count", messages.count).Field("bytes", messages.bytes);
    json.Field("bytes_per_keyframe",
               Ratio(static_cast<double>(messages.bytes), static_cast<double>(NumMoments(report))));
    json.EndObject();
  }
  json.EndObject();
}

void WriteLatency(const ReplayLatency& latency, JsonWriter& json) {
  json.Key("latency_ms").BeginObject();
  for (const auto& [name, step] : ByName(latency)) {
    json.Key(name).BeginObject().Field("count", step.count).Field("mean", step.mean_ms);
    json.Field("p50", step.p50_ms).Field("p95", step.p95_ms).EndObject();
  }
  json.EndObject();
}

void WriteCpu(const ReplayCpu& cpu, JsonWriter& json) {
  json.Key("cpu_s").BeginObject();
  json.Field("process", cpu.process_s).Field("reading", cpu.reading_s);
  json.Field("device", cpu.process_s - cpu.reading_s);
  json.Field("tracking", cpu.tracking_s).Field("localization", cpu.localization_s);
  json.Field("extraction", cpu.extraction_s);
  json.Field("local_mapping", cpu.local_mapping_s).Field("network", cpu.network_s).EndObject();
}

void WriteFragments(const std::vector<ReplayFragment>& fragments, JsonWriter& json) {
  json.Key("fragments").BeginArray();
  for (const ReplayFragment& fragment : fragments) {
    json.BeginObject().Field("session_id", fragment.session_id).Field("frames_tracked", fragment.frames_tracked);
    json.Field("keyframes", fragment.keyframes).Field("keyframes_uploaded", fragment.keyframes_uploaded);
    json.Field("aligned", fragment.aligned).Field("aligned_at_keyframe", fragment.aligned_at_keyframe).EndObject();
  }
  json.EndArray();
}

void AddFragmentRows(const ReplayReport& report, TextTable& table) {
  if (report.fragments.size() < 2) return;
  const auto num_aligned = std::ranges::count_if(report.fragments, &ReplayFragment::aligned);
  table.AddRow({"frames_aligned", fmt::format("{} ({})", report.frames_aligned,
                                              Percent(Ratio(static_cast<double>(report.frames_aligned),
                                                            static_cast<double>(report.frames))))});
  table.AddRow({"fragments", fmt::format("{}, {} aligned", report.fragments.size(), num_aligned)});
}

}  // namespace

std::optional<double> ReplayReport::Freshness() const {
  if (!overlap_mean) return std::nullopt;
  return 1 - *overlap_mean;
}

std::optional<double> ReplayReport::UploadBytesPerKeyframe() const {
  return Ratio(static_cast<double>(upload_bytes), static_cast<double>(NumMoments(*this)));
}

std::optional<double> ReplayReport::FullBytesPerKeyframe() const {
  return Ratio(static_cast<double>(full_bytes), static_cast<double>(NumMoments(*this)));
}

std::optional<double> ReplayReport::UploadShare() const {
  return Ratio(static_cast<double>(upload_bytes), static_cast<double>(full_bytes));
}

std::string FormatJson(const ReplayReport& report) {
  JsonWriter json;
  json.BeginObject();
  json.Field("sequence", report.sequence).Field("map", report.map).Field("device", report.device);
  json.Field("policy", report.policy).Field("sampler", report.sampler).Field("injection", report.injection);
  json.Field("sharing", report.sharing).Field("alpha", report.alpha);
  json.Field("look_ahead_m", report.look_ahead_m);
  json.Field("session_id", report.session_id);
  json.Field("interrupted", report.interrupted).Field("optimization_pending", report.optimization_pending);
  json.Field("duration_s", report.duration_s);

  json.Field("frames", report.frames).Field("frames_tracked", report.frames_tracked);
  json.Field("frames_aligned", report.frames_aligned);
  json.Field("keyframes", report.keyframes).Field("keyframe_equivalents", report.keyframe_equivalents);
  json.Field("keyframes_uploaded", report.keyframes_uploaded).Field("keyframes_skipped", report.keyframes_skipped);
  json.Field("keyframes_dropped", report.keyframes_dropped).Field("keyframes_rejected", report.keyframes_rejected);
  json.Field("aligned_at_keyframe", report.aligned_at_keyframe).Field("overlap_mean", report.overlap_mean);
  json.Field("freshness", report.Freshness());

  json.Field("upload_bytes", report.upload_bytes).Field("full_bytes", report.full_bytes);
  json.Field("full_features", report.full_features).Field("full_points", report.full_points);
  json.Field("upload_share", report.UploadShare());
  json.Field("upload_bytes_per_keyframe", report.UploadBytesPerKeyframe());
  json.Field("full_bytes_per_keyframe", report.FullBytesPerKeyframe());
  json.Field("query_bytes", report.query_bytes).Field("response_bytes_mean", report.response_bytes_mean);
  json.Field("download_bytes", report.download_bytes).Field("shared_map_requests", report.shared_map_requests);
  json.Field("frames_on_shared_map", report.frames_on_shared_map);
  json.Field("shared_matches_mean",
             Ratio(static_cast<double>(report.shared_matches), static_cast<double>(report.frames_on_shared_map)));
  json.Field("sharing_failures", report.sharing_failures).Field("update_reports", report.update_reports);
  json.Field("cached_tiles", report.cached_tiles).Field("retries", report.retries);
  json.Key("sharing_started_ns").BeginArray();
  for (const int64_t stamp_ns : report.sharing_started_ns) json.Value(stamp_ns);
  json.EndArray();
  WriteTraffic(report, json);

  json.Key("tracking_ms").BeginObject().Field("mean", report.tracking_ms.mean_ms);
  json.Field("p50", report.tracking_ms.p50_ms).Field("p95", report.tracking_ms.p95_ms).EndObject();
  json.Field("local_mapping_ms_total", report.latency.local_mapping.total_ms());
  WriteLatency(report.latency, json);
  WriteCpu(report.cpu, json);
  json.Field("peak_rss_bytes", report.peak_rss_bytes);
  json.Field("ate_m", report.errors.ate_m).Field("ate_scale", report.errors.ate_scale);
  json.Field("ate_joint_m", report.errors.ate_joint_m);
  json.Field("max_joint_error_m", report.errors.max_joint_error_m);
  json.Field("ate_together_m", report.ate_together_m);
  json.Field("ate_uncorrected_m", report.uncorrected_errors.ate_m);
  json.Field("ate_joint_uncorrected_m", report.uncorrected_errors.ate_joint_m);
  WriteFragments(report.fragments, json);
  json.EndObject();
  return std::move(json).Finish();
}

std::string FormatText(const ReplayReport& report) {
  const auto frames = static_cast<double>(report.frames);
  TextTable table({{"session " + std::to_string(report.session_id)}, {report.device}});
  table.AddRow({"frames", std::to_string(report.frames) + (report.interrupted ? " (interrupted)" : "")});
  table.AddRow({"frames_tracked", fmt::format("{} ({})", report.frames_tracked,
                                              Percent(Ratio(static_cast<double>(report.frames_tracked), frames)))});
  AddFragmentRows(report, table);
  table.AddRow(
      {"frames_on_shared_map", fmt::format("{} ({})", report.frames_on_shared_map,
                                           Percent(Ratio(static_cast<double>(report.frames_on_shared_map), frames)))});
  table.AddRow({"keyframes", std::to_string(report.keyframes)});
  table.AddRow({"keyframe_equivalents", std::to_string(report.keyframe_equivalents)});
  table.AddRow({"keyframes_uploaded", std::to_string(report.keyframes_uploaded)});
  if (report.keyframes_rejected > 0) table.AddRow({"keyframes_rejected", std::to_string(report.keyframes_rejected)});
  if (report.keyframes_dropped > 0) table.AddRow({"keyframes_dropped", std::to_string(report.keyframes_dropped)});
  table.AddRow(
      {"aligned_at_keyframe", report.aligned_at_keyframe ? std::to_string(*report.aligned_at_keyframe) : "never"});
  table.AddRow({"overlap_mean", Percent(report.overlap_mean)});
  table.AddRow({"freshness", Percent(report.Freshness())});
  table.AddRow({"upload_bytes_per_keyframe", Bytes(report.UploadBytesPerKeyframe())});
  table.AddRow({"full_bytes_per_keyframe", Bytes(report.FullBytesPerKeyframe())});
  table.AddRow({"upload_share", Percent(report.UploadShare())});
  table.AddRow({"query_bytes", std::to_string(report.query_bytes)});
  table.AddRow({"response_bytes_mean", Bytes(report.response_bytes_mean)});
  table.AddRow({"download_bytes", std::to_string(report.download_bytes)});
  table.AddRow({"shared_map_requests", std::to_string(report.shared_map_requests)});
  if (report.cached_tiles > 0) table.AddRow({"cached_tiles", std::to_string(report.cached_tiles)});
  for (const auto& [name, step] : ByName(report.latency)) {
    if (step.count == 0) continue;
    table.AddRow({fmt::format("{}_ms", name), fmt::format("p50 {:.1f}, p95 {:.1f}", step.p50_ms, step.p95_ms)});
  }
  table.AddRow({"cpu_s", fmt::format("{:.2f}", report.cpu.process_s - report.cpu.reading_s)});
  table.AddRow({"peak_rss", fmt::format("{:.0f} MB", 1e-6 * static_cast<double>(report.peak_rss_bytes))});
  if (report.optimization_pending) table.AddRow({"optimization", "pending"});
  table.AddRow({"ate_m", Meters(report.errors.ate_m)});
  if (report.errors.ate_scale) table.AddRow({"ate_scale", fmt::format("{:.4g} m a unit", *report.errors.ate_scale)});
  table.AddRow({"ate_joint_m", Meters(report.errors.ate_joint_m)});
  table.AddRow({"max_joint_error_m", Meters(report.errors.max_joint_error_m)});
  if (report.ate_together_m) table.AddRow({"ate_together_m", Meters(report.ate_together_m)});
  return table.Format();
}

}  // namespace mapp
