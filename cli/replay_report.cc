#include "cli/replay_report.h"

#include "cli/text_table.h"
#include "text/json_writer.h"

#include <fmt/format.h>

namespace mapp {
namespace {

std::optional<double> Ratio(double numerator, double denominator) {
  if (denominator <= 0) return std::nullopt;
  return numerator / denominator;
}

std::string Percent(std::optional<double> ratio) { return ratio ? fmt::format("{:.1f} %", 100 * *ratio) : "-"; }
std::string Meters(std::optional<double> meters) { return meters ? fmt::format("{:.4f} m", *meters) : "-"; }
std::string Bytes(std::optional<double> bytes) { return bytes ? fmt::format("{:.0f}", *bytes) : "-"; }

uint64_t NumMoments(const ReplayReport& report) { return report.keyframes + report.keyframe_equivalents; }

}  // namespace

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
  json.Field("policy", report.policy).Field("session_id", report.session_id);
  json.Field("interrupted", report.interrupted).Field("optimization_pending", report.optimization_pending);
  json.Field("duration_s", report.duration_s);

  json.Field("frames", report.frames).Field("frames_tracked", report.frames_tracked);
  json.Field("keyframes", report.keyframes).Field("keyframe_equivalents", report.keyframe_equivalents);
  json.Field("keyframes_uploaded", report.keyframes_uploaded).Field("keyframes_skipped", report.keyframes_skipped);
  json.Field("keyframes_dropped", report.keyframes_dropped).Field("keyframes_rejected", report.keyframes_rejected);
  json.Field("aligned_at_keyframe", report.aligned_at_keyframe).Field("overlap_mean", report.overlap_mean);

  json.Field("upload_bytes", report.upload_bytes).Field("full_bytes", report.full_bytes);
  json.Field("upload_share", report.UploadShare());
  json.Field("upload_bytes_per_keyframe", report.UploadBytesPerKeyframe());
  json.Field("full_bytes_per_keyframe", report.FullBytesPerKeyframe());
  json.Field("query_bytes", report.query_bytes).Field("response_bytes_mean", report.response_bytes_mean);
  json.Field("download_bytes", report.download_bytes).Field("shared_map_requests", report.shared_map_requests);
  json.Field("frames_on_shared_map", report.frames_on_shared_map);
  json.Field("sharing_failures", report.sharing_failures).Field("update_reports", report.update_reports);
  json.Field("retries", report.retries);

  json.Key("tracking_ms").BeginObject();
  json.Field("p50", report.tracking_ms_p50).Field("p95", report.tracking_ms_p95).EndObject();
  json.Field("local_mapping_ms_total", report.local_mapping_ms_total);
  json.Field("ate_m", report.ate_m).Field("ate_joint_m", report.ate_joint_m);
  json.EndObject();
  return std::move(json).Finish();
}

std::string FormatText(const ReplayReport& report) {
  const auto frames = static_cast<double>(report.frames);
  TextTable table({{"session " + std::to_string(report.session_id)}, {report.device}});
  table.AddRow({"frames", std::to_string(report.frames) + (report.interrupted ? " (interrupted)" : "")});
  table.AddRow({"frames_tracked", fmt::format("{} ({})", report.frames_tracked,
                                              Percent(Ratio(static_cast<double>(report.frames_tracked), frames)))});
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
  table.AddRow({"upload_bytes_per_keyframe", Bytes(report.UploadBytesPerKeyframe())});
  table.AddRow({"full_bytes_per_keyframe", Bytes(report.FullBytesPerKeyframe())});
  table.AddRow({"upload_share", Percent(report.UploadShare())});
  table.AddRow({"query_bytes", std::to_string(report.query_bytes)});
  table.AddRow({"response_bytes_mean", Bytes(report.response_bytes_mean)});
  table.AddRow({"download_bytes", std::to_string(report.download_bytes)});
  table.AddRow({"shared_map_requests", std::to_string(report.shared_map_requests)});
  table.AddRow({"tracking_ms", fmt::format("p50 {:.1f}, p95 {:.1f}", report.tracking_ms_p50, report.tracking_ms_p95)});
  table.AddRow({"local_mapping_ms_total", fmt::format("{:.0f}", report.local_mapping_ms_total)});
  if (report.optimization_pending) table.AddRow({"optimization", "pending"});
  table.AddRow({"ate_m", Meters(report.ate_m)});
  table.AddRow({"ate_joint_m", Meters(report.ate_joint_m)});
  return table.Format();
}

}  // namespace mapp
