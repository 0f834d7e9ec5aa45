#pragma once

#include "mapp/client/participant.h"

#include <cstdint>
#include <optional>
#include <string>
#include <vector>

namespace mapp {

/// Messages of one kind.
struct MessageFigures {
  uint64_t count = 0;
  uint64_t bytes = 0;  ///< serialised, retries included
};
struct ReplayTraffic {
  MessageFigures query;
  MessageFigures response;
  MessageFigures upload;
  MessageFigures shared_map_request;
  MessageFigures shared_map;
  MessageFigures update_report;
  MessageFigures evidence;
};

struct ReplayLatency {
  ParticipantLatency participant;
  LatencySummary tracking;      ///< frames on the device's own map
  LatencySummary localization;  ///< frames on the shared map
  LatencySummary local_mapping;
};

/// CPU time of the replay, seconds. What a device would spend is `process_s - reading_s`; the threads' own figures
/// leave out helpers that image processing may start.
struct ReplayCpu {
  double process_s = 0;       ///< from the first frame to the closed session
  double reading_s = 0;       ///< reading or drawing the frames; at --rate real also what ran beside it
  double tracking_s = 0;      ///< tracking thread, frames on the device's own map
  double localization_s = 0;  ///< tracking thread, frames on the shared map
  double extraction_s = 0;    ///< of these two: features of the images
  double local_mapping_s = 0;
  double network_s = 0;
};

/// A stretch of the way that was tracked without being lost for long: a session of its own at the server.
struct ReplayFragment {
  std::optional<uint64_t> session_id;  ///< absent for one that the server was never told of
  uint64_t frames_tracked = 0;
  uint64_t keyframes = 0;
  uint64_t keyframes_uploaded = 0;
  std::optional<uint32_t> aligned_at_keyframe;  ///< absent without a keyframe that was told of as aligning it
  bool aligned = false;                         ///< in the end, be it after the fragment's own end
};

/// Against the ground truth; all absent without.
struct ReplayErrors {
  /// Absolute trajectory error after the best rigid alignment, metres: of the frames with a pose in the map, or, when
  /// no fragment was aligned, of the longest one.
  std::optional<double> ate_m;
  std::optional<double> ate_scale;  ///< metres a unit of the session or map, where only the best alignment tells
  /// The same under the alignment of the map's first session; absent without --align-by or when never aligned.
  std::optional<double> ate_joint_m;
  std::optional<double> max_joint_error_m;  ///< of the frame that is the furthest off there
};

/// What `mapp replay` reports of one device's way. The names are those of the JSON keys. All figures are of all
/// fragments together.
///
/// A device on a shared map makes no keyframes, so figures "per keyframe" divide by all moments at which it mapped or,
/// mapping for itself, would have: `keyframes` + `keyframe_equivalents`. `full_bytes` counts what `upload_all` would
/// have sent at each of them.
struct ReplayReport {
  std::string sequence;
  std::string map;
  std::string device;
  std::string policy;
  std::string sampler;
  std::string injection;
  bool sharing = true;
  double alpha = 0;
  double look_ahead_m = 0;
  uint64_t session_id = 0;   ///< the first fragment's
  bool interrupted = false;  ///< ended by a signal before the last frame
  /// The session was closed, but the end of the map's optimization was not heard of in time; poses are as before it.
  bool optimization_pending = false;
  double duration_s = 0;  ///< from the first frame to the closed session

  uint64_t frames = 0;          ///< played
  uint64_t frames_tracked = 0;  ///< with a pose
  uint64_t frames_aligned = 0;  ///< of these, with a pose in the map in the end
  uint64_t frames_on_shared_map = 0;
  uint64_t shared_matches = 0;  ///< points of the shared map that these were localized by, over all of them
  /// Stamps of the frames on the shared map whose predecessor was not.
  std::vector<int64_t> sharing_started_ns;
  uint64_t keyframes = 0;                       ///< made by the device
  uint64_t keyframe_equivalents = 0;            ///< frames on a shared map at which it would have made one
  uint64_t keyframes_uploaded = 0;              ///< acknowledged by the server
  uint64_t keyframes_skipped = 0;               ///< not sent: the map knows all of it, or alone in its fragment
  uint64_t keyframes_dropped = 0;               ///< not sent: the queue was full
  uint64_t keyframes_rejected = 0;              ///< refused by the server for good
  std::optional<uint32_t> aligned_at_keyframe;  ///< 0 for the session that founds the map; the first aligned fragment's
  std::optional<double> overlap_mean;           ///< over answered queries, by the device's own count

  uint64_t upload_bytes = 0;  ///< keyframes and update reports, retries included
  uint64_t full_bytes = 0;
  uint64_t full_features = 0;  ///< of the same keyframes
  uint64_t full_points = 0;    ///< of these features, those with a map point
  ReplayTraffic traffic;
  uint64_t query_bytes = 0;  ///< the largest query
  std::optional<double> response_bytes_mean;
  uint64_t download_bytes = 0;  ///< shared maps
  uint64_t shared_map_requests = 0;
  uint64_t sharing_failures = 0;  ///< localisation failures on a shared map
  uint64_t update_reports = 0;
  uint64_t cached_tiles = 0;  ///< of shared maps, from --tile-cache instead of the server
  uint64_t retries = 0;

  LatencySummary tracking_ms;  ///< all frames
  ReplayLatency latency;
  ReplayCpu cpu;
  uint64_t peak_rss_bytes = 0;  ///< of the process, the drawing of frames included

  ReplayErrors errors;
  /// The same without what merges, loops and optimisation have corrected at the server since the keyframes were sent:
  /// as the device knew its way.
  ReplayErrors uncorrected_errors;

  /// RMSE over this session's frames and those of ReplayOptions::together_with, under the one rigid alignment that
  /// suits them together best, metres.
  std::optional<double> ate_together_m;

  std::vector<ReplayFragment> fragments;  ///< in order

  /// Share of the points asked about that the map did not hold: 1 - overlap_mean.
  std::optional<double> Freshness() const;
  std::optional<double> UploadBytesPerKeyframe() const;
  std::optional<double> FullBytesPerKeyframe() const;
  /// upload_bytes / full_bytes.
  std::optional<double> UploadShare() const;
};

std::string FormatJson(const ReplayReport& report);
/// A table of the same keys for people; 52 columns wide at most, so that two stand side by side.
std::string FormatText(const ReplayReport& report);

}  // namespace mapp
