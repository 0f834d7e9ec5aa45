#pragma once

#include "eval/metrics/overlap_metrics.h"
#include "eval/metrics/overlap_oracle.h"
#include "eval/metrics/statistics.h"
#include "mapp/base/id.h"
#include "mapp/base/status.h"
#include "mapp/view/sampler.h"

#include <cstdint>
#include <optional>
#include <string>
#include <vector>

namespace mapp {

struct OverlapStudyOptions {
  std::string database_file;  ///< opened for reading only; a server may own it
  std::string map_name;
  /// Whose whole keyframes are the queries. What they have brought themselves is not part of the map that is asked:
  /// the other sessions' is.
  std::vector<SessionId> query_sessions;
  std::vector<SamplerKind> samplers;
  int num_samples = 1000;      ///< K
  double seen_overlap = 0.9;   ///< T_seen
  size_t min_own_points = 50;  ///< keyframes with fewer points are passed over
  size_t enough_matches = 75;  ///< that localisation needs
  OracleRule rule;
  /// Error of the pose that the map is asked with, one sigma of each axis; the truth is that of the exact pose.
  double pose_noise_m = 0;
  double pose_noise_rad = 0;
  uint64_t seed = 1;
};

/// How one way of assessing overlap fared.
struct OverlapStudyRow {
  SamplerKind sampler = SamplerKind::kDepthSketch;
  OverlapScore by_geometry;    ///< against what the map holds by geometry
  OverlapScore by_descriptor;  ///< against what could be matched by its looks
  /// Of the points that it calls known, the share with a matching descriptor.
  std::optional<double> matched_of_known;
  /// Of the views that it calls seen, the share with enough matching descriptors to localise.
  std::optional<double> localisable_of_seen;
  Summary query_bytes;  ///< packed view, without the message around it
  Summary answer_bytes;
};

struct OverlapStudy {
  size_t num_views = 0;            ///< asked
  size_t num_partial_skipped = 0;  ///< keyframes of the query sessions that the device had already reduced
  size_t num_small_skipped = 0;    ///< with too few points
  size_t num_map_points = 0;
  double mean_own_points = 0;
  /// What the geometric oracle itself comes to, as matched_of_known: how far geometry and looks disagree.
  std::optional<double> oracle_matched_of_known;
  std::vector<OverlapStudyRow> rows;  ///< as options.samplers
};

/// Asks a map what it holds of the keyframes that sessions once sent, by the server's and the device's own code, and
/// compares with what it truly holds: the table of the study behind DESIGN 5 on a real map.
/// INVALID_ARGUMENT naming the option: no sessions or samplers, a session of another map or listed twice, no other
/// session in the map, no keyframe to ask with. NOT_FOUND: no such file, map or session. Else the store's errors.
StatusOr<OverlapStudy> RunOverlapStudy(const OverlapStudyOptions& options);

}  // namespace mapp
