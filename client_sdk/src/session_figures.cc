#include "session_figures.h"

#include <algorithm>

namespace mapp {
namespace {

void AddTraffic(TrafficCounters& sum, const TrafficCounters& more) {
  sum.query_bytes += more.query_bytes;
  sum.num_queries += more.num_queries;
  sum.max_query_bytes = std::max(sum.max_query_bytes, more.max_query_bytes);
  sum.response_bytes += more.response_bytes;
  sum.max_response_bytes = std::max(sum.max_response_bytes, more.max_response_bytes);
  sum.upload_bytes += more.upload_bytes;
  sum.num_uploads += more.num_uploads;
  sum.download_bytes += more.download_bytes;
  sum.shared_map_request_bytes += more.shared_map_request_bytes;
  sum.num_shared_map_requests += more.num_shared_map_requests;
  sum.report_bytes += more.report_bytes;
  sum.num_reports += more.num_reports;
  sum.evidence_bytes += more.evidence_bytes;
  sum.num_evidence_reports += more.num_evidence_reports;
  sum.num_retries += more.num_retries;
}

}  // namespace

SessionFigures& SessionFigures::operator+=(const SessionFigures& later) {
  const ParticipantStats& more = later.counts;
  counts.num_keyframes += more.num_keyframes;
  counts.num_uploaded += more.num_uploaded;
  counts.num_dropped += more.num_dropped;
  counts.num_skipped += more.num_skipped;
  counts.num_rejected += more.num_rejected;
  if (!more.last_error.empty()) counts.last_error = more.last_error;
  if (!counts.aligned_at_keyframe) counts.aligned_at_keyframe = more.aligned_at_keyframe;
  counts.quarantine_reason = more.quarantine_reason;
  counts.overlap_sum += more.overlap_sum;
  counts.num_overlaps += more.num_overlaps;
  counts.full += more.full;
  counts.num_sharing_failures += more.num_sharing_failures;
  counts.num_update_reports += more.num_update_reports;
  counts.num_cached_tiles += more.num_cached_tiles;
  AddTraffic(counts.traffic, more.traffic);
  counts.network_cpu_s += more.network_cpu_s;
  for (size_t step = 0; step < latency.size(); ++step) latency[step].Add(later.latency[step]);
  return *this;
}

ParticipantStats SessionFigures::Summary() const {
  ParticipantStats stats = counts;
  const auto summary = [this](Step step) { return latency.at(static_cast<size_t>(step)).Summary(); };
  stats.latency = {.overlap_assessment = summary(Step::kOverlapAssessment),
                   .redundancy_control = summary(Step::kRedundancyControl),
                   .keyframe_upload = summary(Step::kKeyframeUpload),
                   .shared_map = summary(Step::kSharedMap),
                   .first_shared_tile = summary(Step::kFirstSharedTile),
                   .update_report = summary(Step::kUpdateReport)};
  return stats;
}

}  // namespace mapp
