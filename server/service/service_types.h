#pragma once

#include "mapp/codec/query_codec.h"
#include "mapp/map/tile.h"
#include "storage/records.h"

#include <cstdint>
#include <limits>
#include <optional>
#include <string>
#include <vector>

namespace mapp {

struct OpenSessionInput {
  std::string map_name;
  std::string device;
  SensorKind sensor = SensorKind::kRgbd;
  Camera camera;
  FeatureSettings features = {};
  bool create_map = false;
};
struct OpenedSession {
  SessionId session;
  MapRecord map;
};
struct AssessedOverlap {
  OverlapAnswer answer;
  Revision map_revision;
};
struct UploadResult {
  FrameId frame;
  bool already_stored = false;
  Revision map_revision;
  std::optional<Pose3> T_map_session;
  double scale_map_session = 1;  ///< SessionRecord::scale_map_session
};
/// Of MapService::ReportEvidence.
struct StoredEvidence {
  bool already_stored = false;
  size_t num_points = 0;          ///< stored now
  size_t num_unknown_points = 0;  ///< sent, and left out
};
struct HeldTile {
  TileKey key;
  Revision revision;
  std::optional<uint32_t> crc32c = {};  ///< of the encoded tile; absent: the revision alone tells whether it is current
};
/// Where a device may be soon (DESIGN 9).
struct LookAhead {
  double distance_m = 0;  ///< along the way; range [0, kMaxLookAheadM], 0 = none
  /// How the camera moved lately, in the frame of the view's pose; zero: it stood still. Only its direction counts.
  Eigen::Vector3d motion = Eigen::Vector3d::Zero();
  bool earlier_ways = false;  ///< where earlier sessions went on from here, too
};
inline constexpr double kMaxLookAheadM = 100;
struct SharedMapInput {
  SessionId session;
  ViewQuery view;
  double oversharing = 1.3;  ///< alpha
  std::vector<HeldTile> held_tiles;
  uint64_t max_bytes = 0;  ///< 0 = no budget
  /// Nothing is sent where fewer of the points in the cone than this share were seen by other sessions; [0, 1].
  double min_seen_by_others = 0;
  LookAhead look_ahead = {};
};
struct SharedMapResult {
  Revision map_revision;
  bool is_own_map = false;  ///< nothing was sent because of min_seen_by_others
  uint32_t num_tiles_sent = 0;
  uint32_t num_tiles_unchanged = 0;
  uint32_t num_tiles_over_budget = 0;
  uint32_t num_tiles_sent_ahead = 0;  ///< of those sent: outside the cone
  /// Indices of held tiles: those of num_tiles_unchanged, and those around the view that are not as the map has them
  /// and were not sent.
  std::vector<uint32_t> unchanged_held = {};
  std::vector<uint32_t> outdated_held = {};
};
enum class UpdateVerdict { kNone = 1, kExpansion = 2, kUpdating = 3 };
struct UpdateResult {
  UpdateVerdict verdict = UpdateVerdict::kNone;
  std::vector<MapPointId> missing_points;
  std::vector<Aabb> missing_boxes;
  double new_share = 0;
};
struct ClosedSession {
  int64_t num_keyframes = 0;
  bool optimization_pending = false;
};
/// Where the map has a session's keyframes.
struct SessionPoses {
  std::vector<FrameRecord> frames;  ///< in the map, by number
  Revision map_revision;
};
/// What a reversion has changed, or would.
struct RevertedSession {
  SessionId session;
  Revision map_revision;  ///< 0: nothing of it was in the map
  size_t num_frames = 0;
  size_t num_points = 0;  ///< that nobody else observes
  size_t num_sessions_to_optimize = 0;
};
/// What forgetting a session has taken, or would take.
struct ErasedSession {
  Revision map_revision;  ///< the map's oldest one now
  size_t num_frames = 0;  ///< of the keyframe log
  size_t num_points = 0;
  size_t num_points_kept = 0;             ///< of its points, those that others observe
  std::vector<std::string> dropped_tags;  ///< of earlier revisions
};
/// In which sessions to look for changes of the world: those opened in [from_ns, to_ns], Unix time.
struct ChangeSearch {
  std::string map_name;
  int64_t from_ns = std::numeric_limits<int64_t>::min();
  int64_t to_ns = std::numeric_limits<int64_t>::max();
  double auto_accept = 0;  ///< least confidence of what is accepted at once; 0: nothing
};
struct DetectedChanges {
  std::vector<ChangeRecord> changes;  ///< that this time tells of, by id
  size_t num_new = 0;
  size_t num_dropped = 0;  ///< proposed earlier, and no more
  size_t num_accepted = 0;
  size_t num_sessions = 0;       ///< that told
  size_t num_sessions_read = 0;  ///< of them, those whose keyframes were read
};
struct ReleasedSession {
  SessionRecord session;
  size_t num_frames_taken_in = 0;  ///< frames that had been left out of the map
};

}  // namespace mapp
