#pragma once

#include "mapp/base/latency.h"
#include "mapp/base/status.h"
#include "mapp/camera/camera_model.h"
#include "mapp/client/map_client.h"
#include "mapp/client/slam_adapter.h"
#include "mapp/feature/feature_settings.h"
#include "mapp/map/keyframe.h"
#include "mapp/view/sampler.h"

#include <chrono>
#include <cstdint>
#include <functional>
#include <memory>
#include <optional>
#include <string>
#include <vector>

namespace mapp {

enum class UploadPolicy {
  kMap,        ///< ask first, upload what is fresh, localise on shared maps (the system)
  kUploadAll,  ///< the vanilla shared-map baseline: every keyframe whole, no sharing
};
/// What redundancy injection keeps of the redundant points (DESIGN 6).
enum class Injection { kOften, kNone, kRandom };

/// Tiles that a device keeps beyond its sessions, so that what it was sent once is not sent again. Each is checked
/// against the map, by checksum, before it is used; one that is damaged, or of another format, is removed and fetched
/// anew. Devices may share a folder.
struct TileCacheOptions {
  std::string folder;  ///< made when it is not there; empty: no cache
  /// Of all maps in the folder; beyond it tiles used least lately go. A tile is some 10 to 500 KB. At least 1 MB.
  uint64_t max_bytes = uint64_t{256} << 20;
};

struct ParticipantOptions {
  std::string map_name;
  std::string device = "device";
  bool create_map = true;
  /// Of the keyframes that will be handed in: a map that was made with others refuses the session by name. Give your
  /// own extractor's where it is not the built-in one; Device fills in its tracker's.
  FeatureSettings features = {};
  UploadPolicy policy = UploadPolicy::kMap;
  Injection injection = Injection::kOften;
  SamplerKind sampler = SamplerKind::kDepthSketch;
  int num_samples = 1000;     ///< K; range [1, 1000]
  double seen_overlap = 0.9;  ///< T_seen; range (0, 1]
  /// Off: where the map knows a view the device neither asks for it nor uploads, and goes on mapping for itself (the
  /// paper's "w/o sharing").
  bool sharing = true;
  /// A shared map is taken where other sessions have seen at least this share of the points in view. Where fewer, the
  /// device's own map is the better one: it holds more points than were sent, refined since. Range [0, 1].
  double min_seen_by_others = 0.5;
  double oversharing = 1.3;      ///< alpha; range [1, 4]
  int max_shared_map_tries = 2;  ///< f of algorithm 1
  /// A shared map reaches so far ahead along the device's way, straight on and where earlier sessions went on from
  /// here, metres; 0: it is what the view shows and no more. Range [0, 100]. Source: docs/decisions/0019.
  double look_ahead_m = 10;
  /// What one shared map may bring in tiles, bytes, nearest first; the next brings more. 0: no limit, else at least
  /// 65536. Less than the nearest tile takes is no map: the device goes on mapping for itself.
  uint64_t max_shared_map_bytes = 0;
  TileCacheOptions tile_cache = {};
  /// While it localises on shared maps the device tells the server which of a sample of their points it saw and which
  /// it missed, so that changes of the world are found though nothing is uploaded: some hundreds of bytes a minute
  /// (docs/formats/evidence.md).
  bool report_evidence = true;
  /// Keyframes waiting for the server; beyond it the oldest is dropped and counted.
  size_t max_queued_keyframes = 200;
  Status Validate() const;
};

enum class ParticipantState { kRegistering, kExpanding, kSharing, kClosed };

/// Keyframes as upload_all sends them.
struct KeyframeTotals {
  uint64_t num_keyframes = 0;
  uint64_t bytes = 0;  ///< encoded, whole
  uint64_t num_features = 0;
  uint64_t num_points = 0;  ///< features with a map point

  static KeyframeTotals Of(const Keyframe& keyframe);
  KeyframeTotals& operator+=(const KeyframeTotals& other);
};

/// How long a session's steps took when they succeeded, retries and the pauses between them included.
struct ParticipantLatency {
  LatencySummary overlap_assessment;  ///< from the query to its answer
  LatencySummary redundancy_control;  ///< the device's own count and what it then removes; no network
  LatencySummary keyframe_upload;     ///< to the acknowledgement
  LatencySummary shared_map;          ///< from the request to the last byte, decoded
  LatencySummary first_shared_tile;   ///< to the first tile, decoded, of those that brought any
  LatencySummary update_report;
};

struct ParticipantStats {
  uint64_t num_keyframes = 0;  ///< handed in
  uint64_t num_uploaded = 0;   ///< acknowledged by the server
  uint64_t num_dropped = 0;    ///< for want of room in the queue
  /// Not sent, because the map knows all of it, or because it was alone in its fragment: no place is told by one view.
  uint64_t num_skipped = 0;
  uint64_t num_rejected = 0;                    ///< refused for good, by the server or for being malformed
  std::string last_error;                       ///< of the latest call that failed for good; empty when none did
  std::optional<uint32_t> aligned_at_keyframe;  ///< of several fragments, the first's that was aligned
  /// Set while the server has the latest session in quarantine: its keyframes are refused and counted as rejected.
  std::optional<std::string> quarantine_reason;
  double overlap_sum = 0;  ///< over answered queries, by the device's own count
  uint64_t num_overlaps = 0;
  KeyframeTotals full;  ///< what upload_all would have sent for the keyframes handed in
  uint64_t num_sharing_failures = 0;
  uint64_t num_update_reports = 0;
  uint64_t num_cached_tiles = 0;  ///< of shared maps, taken from TileCacheOptions::folder instead of the server
  TrafficCounters traffic;
  ParticipantLatency latency;
  double network_cpu_s = 0;  ///< CPU time of the network thread: coding, counting, redundancy control
};

/// Where one fragment of a participant's way stands. Each is a session of its own at the server.
struct ParticipantFragment {
  std::optional<SessionId> session;  ///< absent until the server has opened it
  ParticipantState state = ParticipantState::kRegistering;
  std::optional<Pose3> T_map_session;  ///< absent until it is aligned; may come after the fragment's end
  double scale_map_session = 1;        ///< AlignedEvent::scale_map_session
  ParticipantStats stats;

  /// From the fragment's frame and unit to the map's; absent until it is aligned.
  std::optional<Sim3> S_map_session() const {
    if (!T_map_session) return std::nullopt;
    return Sim3{scale_map_session, *T_map_session};
  }
};

/// A device of a single camera (SensorKind::kMono) uploads all its keyframes whole and is not asked to localise on
/// shared maps, which are in the map's unit of length. The life of a session (DESIGN 3) for any SLAM system:
/// registering, expanding, sharing, failing (algorithm 1), closing. A system that has lost its place for good goes on
/// in a new *fragment*, in a session of its own. Owns a network thread a fragment; nothing here waits for the network
/// except Open, WaitIdle and Close. Thread-safe, but OnKeyframe, OnSharedMapFrame and BeginFragment belong to one
/// thread.
class Participant {
 public:
  /// Opens the session. `adapter` must outlive the participant and may be null with kUploadAll.
  /// Waits until the server tells of the session's events, so that none is missed. UNAVAILABLE, DEADLINE_EXCEEDED: the
  /// server cannot be reached. FAILED_PRECONDITION: the map was made with other feature settings, or the tile cache's
  /// folder cannot be made or written; later troubles with that only cost its use, and are told in `last_error`.
  static StatusOr<std::unique_ptr<Participant>> Open(const MapClientOptions& client_options,
                                                     const ParticipantOptions& options, const Camera& camera,
                                                     SensorKind sensor, SlamAdapter* adapter);
  ~Participant();  ///< Drops what is queued; call Close to send it.

  /// A new whole keyframe, pose T_session_camera, features with points. `number` grows from keyframe to keyframe.
  /// Queued; returns at once. On the wire the numbers run on after keyframes that OnSharedMapFrame handed in.
  void OnKeyframe(Keyframe keyframe);
  /// How a frame fared on the shared map; a failure resumes queries (algorithm 1). `last_keyframe` makes the whole
  /// keyframe of that frame and is called, on this thread, only when it failed, and about once a metre of way
  /// (ParticipantOptions::report_evidence). Depths it has measured beyond its points belong into Keyframe::raster.
  void OnSharedMapFrame(const SharedMapFrame& frame, const std::function<std::optional<Keyframe>()>& last_keyframe);
  /// The system has begun a new map in a new frame `session` whose place relative to the last one it does not know.
  /// What is handed in from now on belongs to a new session, with numbers from 0. The one before is sent to its end and
  /// closed, the new one opened once it holds two keyframes, both in the background, again and again while the server
  /// cannot be reached; until then keyframes queue as ever. Once this returns, no map of the session before reaches the
  /// adapter: drop one that came earlier. Call it without a lock that the adapter's functions take.
  void BeginFragment();

  /// These three are of the present fragment.
  ParticipantState state() const;
  /// Absent until the session is aligned.
  std::optional<Pose3> T_map_session() const;
  /// The same with the session's scale (ParticipantFragment): a device that does not measure depth needs this one.
  std::optional<Sim3> S_map_session() const;
  std::optional<SessionId> session() const;  ///< absent until the server has opened it
  /// All fragments, in order. The alignments of the latest 16 are followed after their end.
  std::vector<ParticipantFragment> fragments() const;
  /// Where the map has the keyframes of each fragment now, in the order of fragments(): merges, loops and optimisation
  /// correct their poses after the upload. Waits for the server; after Close too. None for fragments that are not
  /// aligned, and those before the latest 17. Errors are the calls'.
  StatusOr<std::vector<std::vector<ClientKeyframePose>>> FetchKeyframePoses();
  /// Waits until every queued keyframe is sent and, while registering, compared with the map by the server; that
  /// sessions of ended fragments are closed and the optimisations that follow are done. A keyframe that is alone in its
  /// fragment is not waited for, nor what the server has refused. DEADLINE_EXCEEDED when that takes longer, or the
  /// error of closing a session.
  Status WaitIdle(std::chrono::milliseconds timeout);
  /// Sends what is queued, closes the sessions and, with `wait_for_optimization`, waits for the optimisations to end.
  /// Keyframes handed in from now on are dropped. DEADLINE_EXCEEDED says what is still to be done; call again.
  Status Close(std::chrono::milliseconds timeout, bool wait_for_optimization);
  ParticipantStats stats() const;  ///< of all fragments together

 private:
  struct Impl;
  explicit Participant(std::unique_ptr<Impl> impl);
  std::unique_ptr<Impl> impl_;
};

}  // namespace mapp
