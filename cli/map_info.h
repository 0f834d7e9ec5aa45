#pragma once

#include "mapp/base/latency.h"
#include "mapp/base/process_usage.h"
#include "mapp/camera/camera_model.h"
#include "mapp/feature/feature_settings.h"
#include "mapp/geometry/pose3.h"

#include <Eigen/Core>

#include <cstdint>
#include <optional>
#include <string>
#include <vector>

namespace mapp {

/// What AdminService tells of maps and sessions, for the commands that print it.
struct MapSummary {
  uint64_t id = 0;
  std::string name;
  int64_t created_unix_ns = 0;
  uint64_t revision = 0;
  uint64_t num_frames = 0;
  uint64_t num_points = 0;
  uint64_t num_sessions = 0;
  double tile_edge_m = 0;
  double cone_range_m = 0;
  /// Of all its sessions; absent where the server is too old to tell.
  std::optional<FeatureSettings> features;
  bool scale_unknown = false;  ///< its lengths are in a unit of its own
  uint64_t num_tiles = 0;      ///< only from GetMap
  std::optional<Aabb> bounds;  ///< of the map's tiles, frame `map`; only from GetMap, absent for an empty map
};

/// The latest one of a session.
struct QuarantineSummary {
  int64_t since_unix_ns = 0;
  std::string reason;
  int64_t released_unix_ns = 0;  ///< 0 while it stands
};

/// What taking a session out of its map has changed, or would.
struct RevertedSummary {
  uint64_t map_revision = 0;  ///< 0: nothing of it was in the map
  uint64_t num_frames = 0;
  uint64_t num_points = 0;  ///< that nobody else observes
  uint64_t num_sessions_to_optimize = 0;
};

/// What forgetting a session has taken, or would.
struct ErasedSummary {
  uint64_t map_revision = 0;  ///< the map's oldest one now
  uint64_t num_frames = 0;    ///< of the keyframe log
  uint64_t num_points = 0;
  uint64_t num_points_kept = 0;           ///< of its points, those that others observe
  std::vector<std::string> dropped_tags;  ///< of earlier revisions
};

/// How far the optimisation of a whole map is.
struct MapOptimizationStep {
  uint32_t round = 0;  ///< between rounds, points that turn out to be one are fused
  uint32_t num_frames = 0;
  uint32_t num_points = 0;
  uint32_t pass = 0;  ///< 0: with all observations, 1: without those that did not fit
  uint32_t num_iterations = 0;
};

/// What came of it.
struct MapOptimizationSummary {
  bool applied = false;  ///< false: the map would not have got better, and is as it was
  double initial_rmse_px = 0;
  double final_rmse_px = 0;
  uint32_t num_frames = 0;
  uint32_t num_points = 0;
  double seconds = 0;
  uint32_t num_rounds = 0;
  uint32_t num_fused = 0;  ///< points that turned out to be another one
};

/// Revisions one after the other that have the same cause and session.
struct RevisionRunSummary {
  uint64_t first = 0, last = 0;
  uint64_t num_revisions = 0;
  int64_t first_unix_ns = 0, last_unix_ns = 0;
  std::string cause;        ///< "keyframe", "change undone", ...
  uint64_t session_id = 0;  ///< 0: of none alone
  std::string device;
};

struct TagSummary {
  std::string name;
  uint64_t revision = 0;
  int64_t created_unix_ns = 0;
};

struct RevisionLogSummary {
  std::vector<RevisionRunSummary> runs;  ///< newest first
  bool truncated = false;                ///< there are older ones
  uint64_t oldest_revision = 0;          ///< that can still be read
  std::vector<TagSummary> tags;          ///< by name
};

/// How the map differs between two revisions in what one session has brought.
struct SessionDiffSummary {
  uint64_t session_id = 0;
  std::string device;
  uint64_t frames_added = 0, frames_moved = 0, frames_removed = 0;
  uint64_t points_added = 0, points_moved = 0, points_removed = 0;
};

struct MapDiffSummary {
  uint64_t from = 0, to = 0;
  std::vector<SessionDiffSummary> sessions;
};

/// How far the export of a bundle is.
struct BundleExportStep {
  uint64_t frames_done = 0, frames_total = 0;
  uint64_t num_bytes = 0;  ///< received
};

/// How far the import of a bundle is.
struct BundleImportStep {
  enum class Phase { kSending, kChecking, kWriting };
  Phase phase = Phase::kSending;
  uint64_t bytes_done = 0, bytes_total = 0;
};

struct ImportSummary {
  MapSummary map;
  uint64_t num_frames = 0, num_points = 0;  ///< fragments and what is kept out of the map counted
};

/// What of a map's history is to stay.
struct CompactionOrder {
  std::string map_name;
  std::optional<uint64_t> keep_revisions;
  std::optional<double> keep_days;
  bool dry_run = false;
  bool rewrite = false;  ///< the whole file afterwards
};

/// How far a compaction is.
struct CompactionStep {
  uint64_t rows_done = 0, rows_total = 0;
  uint64_t bytes_left = 0;  ///< to give back
};

struct CompactionSummary {
  uint64_t oldest_before = 0, oldest = 0;  ///< revisions that can be read
  std::string kept_for_tag;                ///< without which more would go
  uint64_t num_rows = 0;
  uint64_t num_bytes_given_back = 0;
};

struct SessionSummary {
  uint64_t id = 0;
  std::string map_name;
  std::string device;
  SensorKind sensor = SensorKind::kRgbd;
  int64_t opened_unix_ns = 0;
  int64_t closed_unix_ns = 0;          ///< 0 while it is open
  std::optional<Pose3> T_map_session;  ///< absent while the session is a fragment of its own
  double scale_map_session = 1;        ///< metres a unit of the session's
  std::optional<uint32_t> aligned_at_keyframe;
  uint64_t num_keyframes = 0;
  uint64_t num_upload_bytes = 0;
  std::optional<QuarantineSummary> quarantine;
};

/// A keyframe that stands in the map.
struct MapFrameSummary {
  uint64_t session_id = 0;
  uint32_t keyframe = 0;  ///< its number within the session, from 0
  int64_t stamp_ns = 0;
  Pose3 T_map_camera;
  bool partial = false;  ///< redundancy control had removed features
};

struct MapPointSummary {
  Eigen::Vector3d p_map = Eigen::Vector3d::Zero();  ///< metres
  uint32_t num_observations = 0;
  float confidence = 0;
  uint64_t session_id = 0;  ///< that brought it
  uint64_t id = 0;
};

struct MapContent {
  MapSummary map;
  std::vector<MapFrameSummary> frames;
  std::vector<MapPointSummary> points;
};

struct MethodSummary {
  std::string method;
  uint64_t num_errors = 0;
  LatencySummary latency;  ///< inside the server; its count is that of all calls
};

/// What the server does behind its methods: integration, alignment, optimization.
struct StepSummary {
  std::string step;
  LatencySummary latency;
};

struct ServerSummary {
  std::string version;
  uint32_t schema_version = 0;
  int64_t started_unix_ns = 0;
  std::vector<MethodSummary> methods;
  std::vector<StepSummary> steps;
  ProcessUsage usage;  ///< of the server's process
};

}  // namespace mapp
