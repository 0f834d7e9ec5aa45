#pragma once

#include "mapp/base/id.h"
#include "mapp/camera/camera_model.h"
#include "mapp/feature/feature.h"
#include "mapp/feature/feature_settings.h"
#include "mapp/geometry/oriented_box.h"
#include "mapp/geometry/pose3.h"
#include "mapp/map/keyframe.h"
#include "mapp/map/tile.h"

#include <Eigen/Core>

#include <cstdint>
#include <optional>
#include <string>
#include <vector>

namespace mapp {

struct MapRecord {
  MapId id;
  std::string name;
  int64_t created_ns = 0;  ///< Unix time
  Revision revision;
  double tile_edge_m = kDefaultTileEdgeM;
  double cone_range_m = 20.0;  ///< h
  /// The session whose frame became the frame `map`; none while the map is empty.
  std::optional<SessionId> founder;
  /// False: a camera without scale has founded it, and nobody with metres has joined. Its unit of length is no metre
  /// then, and names that say metres mean that unit (docs/decisions/0014).
  bool has_metric_scale = true;
  int64_t num_frames = 0;  ///< frames that stand in the map, fragments not counted
  int64_t num_points = 0;  ///< live points in the map's frame
  int64_t num_sessions = 0;
  /// Of all its sessions; from the one that created it.
  FeatureSettings features = {};
  /// The oldest one that ReadAsOf still gives.
  Revision oldest_revision = {};
};

struct CameraRecord {
  CameraId id;
  Camera camera;
};

/// A session whose uploads contradicted the map or themselves: nothing of it enters the map any more.
struct Quarantine {
  int64_t since_ns = 0;  ///< Unix time
  std::string reason;    ///< for operators: what was found, in figures
  /// An operator has lifted it; the session is not judged again.
  std::optional<int64_t> released_ns;
};

struct SessionRecord {
  SessionId id;
  MapId map;
  std::string device;
  CameraId camera;
  SensorKind sensor = SensorKind::kRgbd;
  int64_t opened_ns = 0;  ///< Unix time
  std::optional<int64_t> closed_ns;
  /// Absent while the session is a fragment of its own.
  std::optional<Pose3> T_map_session;
  /// Metres a unit of length of the session's: 1 while it is a fragment, and of sensors that measure metres.
  double scale_map_session = 1;
  std::optional<uint32_t> aligned_at_keyframe;
  /// Revision of the optimisation that followed its closing; absent = still owed.
  std::optional<Revision> optimized;
  int64_t num_keyframes = 0;
  int64_t num_upload_bytes = 0;
  /// The latest one, lifted or not.
  std::optional<Quarantine> quarantine;

  bool IsQuarantined() const { return quarantine && !quarantine->released_ns; }
  /// From what the session's device tells to the map. Requires T_map_session.
  Sim3 S_map_session() const { return {scale_map_session, *T_map_session}; }
};

struct FrameRecord {
  FrameId id;
  MapId map;
  SessionId session;
  CameraId camera;
  uint32_t number = 0;  ///< the session's keyframe number K
  int64_t stamp_ns = 0;
  /// False while its session is a fragment: then the pose below is T_session_camera.
  bool in_map = false;
  Pose3 T_frame_camera;  ///< T_map_camera when in_map, else T_session_camera, in the session's unit of length
  bool partial = false;
  std::optional<float> overlap;  ///< as the device reported it
  uint32_t num_features = 0;
  int64_t num_packet_bytes = 0;
  Revision created;
};

/// Feature `feature_idx` of a frame's packet observes `point`.
struct Observation {
  uint16_t feature_idx = 0;
  MapPointId point;
  float depth_m = 0;  ///< as the device measured it; 0 = none
};

struct PointRecord {
  MapPointId id;
  SessionId session;                                   ///< whose upload created it
  uint64_t session_point = 0;                          ///< the device's own number for it
  bool in_map = false;                                 ///< false: position and direction are in the session's frame
  Eigen::Vector3d position = Eigen::Vector3d::Zero();  ///< metres, map or session frame
  Eigen::Vector3f view_direction = Eigen::Vector3f::UnitZ();  ///< unit, mean of (point - camera centre), same frame
  OrbDescriptor descriptor;
  float reference_distance_m = 1;  ///< as TilePoint::reference_distance_m
  uint32_t num_observations = 0;
  float confidence = 1;
  std::vector<FrameId> observers;  ///< up to TilePoint::kMaxObservers, most different directions
  Revision created;                ///< of this version of the point
};

/// A session's number for a point, and the point that this founded.
struct NumberedPoint {
  uint64_t session_point = 0;
  MapPointId point;
  friend bool operator==(const NumberedPoint&, const NumberedPoint&) = default;
};

struct TileRecord {
  TileKey key;
  Revision revision;  ///< of the last commit that changed its content
  int64_t num_points = 0;
};

/// What a revision was made for. The values are stored.
enum class RevisionCause : uint8_t {
  kUnknown = 0,  ///< made before causes were kept
  kKeyframe = 1,
  kAlignment = 2,  ///< a fragment has entered the map, or a session's place in it was refined
  kLoop = 3,
  kOptimization = 4,
  kFusion = 5,  ///< points that turned out to be one
  kRescaling = 6,
  kRetirement = 7,  ///< of what a quarantined session had brought
  kReversion = 8,   ///< a session's whole contribution was taken out on command
  kReturn = 9,      ///< what had been taken out or left out of a session has entered the map
  kErasure = 10,    ///< a session was forgotten
  kImport = 11,     ///< all of the map came from a bundle
  kChange = 12,     ///< an accepted change of the world was applied
  kChangeUndone = 13,
  kLast = kChangeUndone,  ///< storage/sqlite/verify_catalog.cc knows it as a number
};

struct RevisionRecord {
  Revision revision;
  int64_t committed_ns = 0;  ///< Unix time
  RevisionCause cause = RevisionCause::kUnknown;
  std::optional<SessionId> session;  ///< whose keyframe, alignment, ... it was
};

/// An operator's name for a revision.
struct TagRecord {
  std::string name;
  Revision revision;
  int64_t created_ns = 0;  ///< Unix time
};

/// How the map differs between two revisions in what one session has brought. A frame or point that entered the map
/// counts as added, one that left it as removed.
struct SessionDiff {
  SessionId session;
  int64_t frames_added = 0, frames_moved = 0, frames_removed = 0;
  int64_t points_added = 0, points_moved = 0, points_removed = 0;
  friend bool operator==(const SessionDiff&, const SessionDiff&) = default;
};

/// What a device on a shared map found of its points, as it sent it (codec/evidence_codec.h).
struct EvidenceRecord {
  SessionId session;
  uint32_t number = 0;      ///< the session's own, from 0: makes a report idempotent
  int64_t received_ns = 0;  ///< Unix time
  std::string packet;
};

/// What became of a thing in the world. The values are stored.
enum class ChangeKind : uint8_t { kAppeared = 1, kVanished = 2, kMoved = 3 };

/// What an operator made of a change. The values are stored.
enum class ChangeStatus : uint8_t {
  kProposed = 1,
  kAccepted = 2,  ///< and applied to the map
  kRejected = 3,  ///< no change: what it rests on proposes it no more
};

/// A change of the world that a map's history tells of (DESIGN 10). Times are the server's: devices' clocks may differ.
struct ChangeRecord {
  ChangeId id;
  MapId map;
  ChangeKind kind = ChangeKind::kVanished;
  ChangeStatus status = ChangeStatus::kProposed;
  double confidence = 0;  ///< probability in [0, 1] that it has happened
  /// It happened between these, Unix times: openings of the last session that found things as they were before, and of
  /// the first that found them as they are after.
  int64_t after_ns = 0;
  int64_t before_ns = 0;
  /// Openings of the first and the last session that saw the thing where it was (kAppeared: where it is), Unix time.
  int64_t first_seen_ns = 0;
  int64_t last_seen_ns = 0;
  std::vector<SessionId> sessions;  ///< whose evidence it rests on, ascending
  /// In the map's frame. kVanished has the first, kAppeared the second, kMoved both.
  std::optional<OrientedBox> box_before;
  std::optional<OrientedBox> box_after;
  std::vector<MapPointId> points_before;  ///< of the thing where it was, ascending
  std::vector<MapPointId> points_after;   ///< of the thing where it is, ascending
  Revision detected;                      ///< the map's when it was found
  std::optional<Revision> applied;        ///< that its acceptance made
};

/// An encoded tile and the revision whose content it holds.
struct TileBlob {
  Revision revision;
  std::string bytes;  ///< codec/tile_codec.h
};

}  // namespace mapp
