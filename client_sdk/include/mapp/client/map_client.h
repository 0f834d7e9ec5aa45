#pragma once

#include "mapp/base/id.h"
#include "mapp/base/status.h"
#include "mapp/camera/camera_model.h"
#include "mapp/codec/query_codec.h"
#include "mapp/feature/feature_settings.h"
#include "mapp/map/keyframe.h"
#include "mapp/map/tile.h"

#include <chrono>
#include <cstdint>
#include <functional>
#include <memory>
#include <optional>
#include <string>
#include <variant>
#include <vector>

namespace mapp {

struct MapClientOptions {
  std::string server_address = "127.0.0.1:7878";  ///< host:port
  std::chrono::milliseconds call_timeout{5000};   ///< deadline of each attempt; shared maps have four times as long
  /// Transient failures (UNAVAILABLE, DEADLINE_EXCEEDED) of idempotent calls are tried again with doubling, jittered
  /// pauses from `first_backoff` to `max_backoff` until `retry_for` has passed.
  std::chrono::milliseconds first_backoff{50};
  std::chrono::milliseconds max_backoff{2000};
  std::chrono::milliseconds retry_for{30000};
  Status Validate() const;  ///< Names the first field out of range.
};

/// Whether a call waits for a server that is away, as MapClientOptions says, or gives up after one attempt.
enum class Patience { kRetry, kOneAttempt };

/// Bytes of serialised messages by kind, both ways, retries included; the counts are of calls, not of attempts.
struct TrafficCounters {
  uint64_t query_bytes = 0;
  uint64_t num_queries = 0;
  uint64_t max_query_bytes = 0;  ///< largest single query
  uint64_t response_bytes = 0;
  uint64_t max_response_bytes = 0;
  uint64_t upload_bytes = 0;
  uint64_t num_uploads = 0;
  uint64_t download_bytes = 0;            ///< shared maps
  uint64_t shared_map_request_bytes = 0;  ///< what was sent to ask for them: the list of held tiles
  uint64_t num_shared_map_requests = 0;
  uint64_t report_bytes = 0;
  uint64_t num_reports = 0;  ///< answered
  uint64_t evidence_bytes = 0;
  uint64_t num_evidence_reports = 0;  ///< acknowledged
  uint64_t num_retries = 0;
};

struct ClientSession {
  SessionId id;
  MapId map;
  double cone_range_m = 20;
  double tile_edge_m = kDefaultTileEdgeM;
  size_t max_keyframe_bytes = 0;
  /// Unix time at which the map was made; with `map` it tells this map from any other. 0: the server does not say.
  int64_t map_created_ns = 0;
};
struct ClientUpload {
  FrameId frame;
  bool already_stored = false;
  std::optional<Pose3> T_map_session;
  double scale_map_session = 1;  ///< as AlignedEvent's
};
/// A tile that the device has, so that the server need not send it again.
struct ClientHeldTile {
  TileKey key;
  Revision revision;
  uint32_t crc32c = 0;  ///< of its encoded bytes
};
/// Where the device may be soon: what comes into view there is sent after what is in view.
struct ClientLookAhead {
  double distance_m = 0;  ///< along its way; range [0, 100], 0 = none
  /// How the camera moved lately, in the frame of the view's pose; zero: it stood still. Only its direction counts.
  Eigen::Vector3d motion = Eigen::Vector3d::Zero();
  bool earlier_ways = true;  ///< where earlier sessions went on from here, not only straight on
};
struct ClientSharedMapRequest {
  uint32_t keyframe = 0;
  ViewQuery view;
  double oversharing = 1.3;  ///< alpha; range [1, 4]
  double overlap = 0;        ///< that made the device ask; range [0, 1]
  /// The answer is empty where others saw a smaller share of the points in view; range [0, 1].
  double min_seen_by_others = 0;
  std::vector<ClientHeldTile> held_tiles;
  uint64_t max_bytes = 0;  ///< of tiles sent, nearest first; 0 = no limit
  ClientLookAhead look_ahead = {};
};
struct ClientTile {
  Tile tile;
  std::string bytes;  ///< as they were sent: docs/formats/tile.md
};
/// The shared map is the tiles sent and the held ones that are unchanged.
struct ClientSharedMap {
  std::vector<ClientTile> tiles;
  std::vector<uint32_t> unchanged_held;  ///< indices into the request's held_tiles
  std::vector<uint32_t> outdated_held;   ///< likewise: copies that are not as the map has the tile, which was not sent
  uint32_t num_tiles_over_budget = 0;
  std::optional<std::chrono::nanoseconds> first_tile_after;  ///< since the request was sent, decoded
  bool is_own_map = false;                                   ///< empty because of min_seen_by_others
  uint64_t map_revision = 0;
};
/// Where the map has a keyframe now.
struct ClientKeyframePose {
  uint32_t number = 0;  ///< on the wire
  int64_t stamp_ns = 0;
  Pose3 T_map_camera;
};
enum class ClientUpdateVerdict { kNone, kExpansion, kUpdating };

/// Events of WatchSession.
struct AlignmentTriedEvent {
  uint32_t keyframe = 0;
  uint32_t num_candidates = 0;
  uint32_t num_inliers = 0;
  uint32_t num_consistent = 0;
};
struct AlignedEvent {
  Pose3 T_map_session;
  uint32_t keyframe = 0;
  /// The map's unit of length (metres, unless its scale is unknown) a unit of the session's: the session's positions
  /// are multiplied by it before T_map_session applies. 1 unless the device has a single camera.
  double scale_map_session = 1;
};
struct CorrectedEvent {
  Pose3 T_map_session;
  double scale_map_session = 1;  ///< as AlignedEvent's
};
struct TilesChangedEvent {
  std::vector<TileKey> keys;
  Revision revision;  ///< of the map at the change
};
struct OptimizedEvent {
  bool applied = false;
  double initial_rmse_px = 0;
  double final_rmse_px = 0;
};
/// The session's uploads contradict the map or themselves: the server takes nothing more of it. What to do is in
/// `reason`'s likely cause: mend the calibration and open a new session, or ask an operator.
struct QuarantinedEvent {
  std::string reason;
};
/// An operator has lifted the quarantine.
struct ReleasedEvent {};
/// The stream stands (again): what happens from now on is told; what happened before may have been missed, but for the
/// present alignment and quarantine, which come just before this.
struct WatchStartedEvent {};
using ClientEvent = std::variant<AlignmentTriedEvent, AlignedEvent, CorrectedEvent, TilesChangedEvent, OptimizedEvent,
                                 QuarantinedEvent, ReleasedEvent, WatchStartedEvent>;

/// The protocol of mapp.v1 with deadlines and retries. Thread-safe. Calls block; keep them off the tracking thread
/// (Participant does). Errors carry the server's code and message.
class MapClient {
 public:
  static StatusOr<std::unique_ptr<MapClient>> Create(const MapClientOptions& options);
  ~MapClient();

  /// Not idempotent: tried again only while the server is UNAVAILABLE. Should it have opened a session all the same,
  /// that one stays empty and harms nobody.
  /// FAILED_PRECONDITION: the map was made with other feature settings.
  StatusOr<ClientSession> OpenSession(const std::string& map_name, const std::string& device, SensorKind sensor,
                                      const Camera& camera, const FeatureSettings& features, bool create_map);
  /// `num_samples`: K of the query, which is also the number of samples drawn from the view.
  StatusOr<OverlapAnswer> AssessOverlap(SessionId session, uint32_t keyframe, const ViewQuery& view,
                                        size_t num_samples);
  StatusOr<ClientUpload> UploadKeyframe(const std::string& packet);
  /// `on_tile` is called, on this thread, with what has come so far after each tile: nearest first, each of use by
  /// itself. Another attempt begins from nothing.
  StatusOr<ClientSharedMap> RequestSharedMap(SessionId session, const ClientSharedMapRequest& wanted,
                                             Patience patience = Patience::kRetry,
                                             const std::function<void(const ClientSharedMap& so_far)>& on_tile = {});
  StatusOr<ClientUpdateVerdict> ReportUpdate(SessionId session, const std::vector<std::string>& packets,
                                             Patience patience = Patience::kRetry);
  /// `packet`: what was seen and missed of the map's points, docs/formats/evidence.md; `number` counts the session's
  /// reports from 0. Durable when it returns OK; the same number again is acknowledged and stored once.
  Status ReportEvidence(SessionId session, uint32_t number, const std::string& packet,
                        Patience patience = Patience::kRetry);
  /// Number of keyframes the server holds of the session, and whether an optimisation follows.
  StatusOr<std::pair<uint64_t, bool>> CloseSession(SessionId session);
  /// The session's keyframes that stand in the map, by number, at their present poses. FAILED_PRECONDITION: it is not
  /// aligned.
  StatusOr<std::vector<ClientKeyframePose>> GetSessionPoses(SessionId session);
  /// Calls `on_event` from a thread of its own until the returned handle is destroyed, which waits for a call under
  /// way; reconnects by itself. Ends early only when the server says that it will never answer (no such session). The
  /// handle must not outlive the client.
  std::unique_ptr<class WatchHandle> WatchSession(SessionId session, std::function<void(const ClientEvent&)> on_event);

  /// Ends waits between retries and calls under way; later calls give CANCELLED. For shutting down.
  void Cancel();
  TrafficCounters traffic() const;

 private:
  struct Impl;
  explicit MapClient(std::unique_ptr<Impl> impl);
  std::unique_ptr<Impl> impl_;
};

class WatchHandle {
 public:
  virtual ~WatchHandle() = default;
};

}  // namespace mapp
