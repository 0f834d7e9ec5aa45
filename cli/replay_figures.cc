#include "cli/replay_figures.h"

#include "mapp/base/latency.h"

#include <chrono>

namespace mapp {
namespace {

std::chrono::nanoseconds Milliseconds(double ms) {
  return std::chrono::duration_cast<std::chrono::nanoseconds>(std::chrono::duration<double, std::milli>(ms));
}

void FillTraffic(const TrafficCounters& traffic, ReplayReport& report) {
  report.traffic = {
      .query = {traffic.num_queries, traffic.query_bytes},
      .response = {traffic.num_queries, traffic.response_bytes},
      .upload = {traffic.num_uploads, traffic.upload_bytes},
      .shared_map_request = {traffic.num_shared_map_requests, traffic.shared_map_request_bytes},
      .shared_map = {traffic.num_shared_map_requests, traffic.download_bytes},
      .update_report = {traffic.num_reports, traffic.report_bytes},
      .evidence = {traffic.num_evidence_reports, traffic.evidence_bytes},
  };
  report.upload_bytes = traffic.upload_bytes + traffic.report_bytes + traffic.evidence_bytes;
  report.query_bytes = traffic.max_query_bytes;
  if (traffic.num_queries > 0) {
    report.response_bytes_mean = static_cast<double>(traffic.response_bytes) / static_cast<double>(traffic.num_queries);
  }
  report.download_bytes = traffic.download_bytes;
  report.shared_map_requests = traffic.num_shared_map_requests;
  report.retries = traffic.num_retries;
}

}  // namespace

void FillFrames(const std::vector<PlayedFrame>& frames, ReplayReport& report) {
  LatencyRecorder all, tracking, localization;
  bool was_on_shared_map = false;
  report.frames = frames.size();
  for (const PlayedFrame& frame : frames) {
    report.frames_tracked += frame.tracked ? 1 : 0;
    report.frames_on_shared_map += frame.on_shared_map ? 1 : 0;
    if (frame.on_shared_map) report.shared_matches += static_cast<uint64_t>(frame.num_shared_matches);
    if (frame.on_shared_map && !was_on_shared_map) report.sharing_started_ns.push_back(frame.stamp_ns);
    was_on_shared_map = frame.on_shared_map;

    all.Add(Milliseconds(frame.tracking_ms));
    (frame.on_shared_map ? localization : tracking).Add(Milliseconds(frame.tracking_ms));
    (frame.on_shared_map ? report.cpu.localization_s : report.cpu.tracking_s) += 1e-3 * frame.tracking_cpu_ms;
    report.cpu.extraction_s += 1e-3 * frame.extraction_cpu_ms;
    report.cpu.reading_s += frame.reading_cpu_s;
  }
  report.tracking_ms = all.Summary();
  report.latency.tracking = tracking.Summary();
  report.latency.localization = localization.Summary();
}

void FillFragments(const std::vector<DeviceFragment>& fragments, ReplayReport& report) {
  for (const DeviceFragment& fragment : fragments) {
    ReplayFragment& entry = report.fragments.emplace_back();
    if (fragment.session.session) entry.session_id = fragment.session.session->value();
    entry.frames_tracked = fragment.trajectory.size();
    entry.keyframes = fragment.session.stats.num_keyframes;
    entry.keyframes_uploaded = fragment.session.stats.num_uploaded;
    entry.aligned_at_keyframe = fragment.session.stats.aligned_at_keyframe;
    entry.aligned = fragment.session.T_map_session.has_value();
    if (entry.aligned) report.frames_aligned += entry.frames_tracked;
  }
  report.session_id = report.fragments.front().session_id.value_or(0);
}

void FillParticipation(const ReplayDevice& device, ReplayReport& report) {
  const ParticipantStats stats = device.stats();
  report.keyframes = stats.num_keyframes;
  report.keyframe_equivalents = device.keyframe_equivalents().num_keyframes;
  report.keyframes_uploaded = stats.num_uploaded;
  report.keyframes_skipped = stats.num_skipped;
  report.keyframes_dropped = stats.num_dropped;
  report.keyframes_rejected = stats.num_rejected;
  report.aligned_at_keyframe = stats.aligned_at_keyframe;
  if (stats.num_overlaps > 0) report.overlap_mean = stats.overlap_sum / static_cast<double>(stats.num_overlaps);
  KeyframeTotals full = stats.full;
  full += device.keyframe_equivalents();
  report.full_bytes = full.bytes;
  report.full_features = full.num_features;
  report.full_points = full.num_points;
  report.sharing_failures = stats.num_sharing_failures;
  report.update_reports = stats.num_update_reports;
  report.cached_tiles = stats.num_cached_tiles;
  FillTraffic(stats.traffic, report);

  const LocalMappingStats local_mapping = device.local_mapping();
  report.latency.participant = stats.latency;
  report.latency.local_mapping = local_mapping.latency;
  report.cpu.local_mapping_s = local_mapping.cpu_s;
  report.cpu.network_s = stats.network_cpu_s;
}

}  // namespace mapp
