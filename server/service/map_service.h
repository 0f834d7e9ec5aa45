#pragma once

#include "mapp/base/call_context.h"
#include "mapp/base/status.h"
#include "mapp/codec/query_codec.h"
#include "mapp/view/view_cone.h"
#include "server/changes/change_scan.h"
#include "server/service/change_decision.h"
#include "server/service/compaction.h"
#include "server/service/map_bundle.h"
#include "server/service/map_history.h"
#include "server/service/optimizer.h"
#include "server/service/registrar.h"
#include "server/service/report_budget.h"
#include "server/service/service_types.h"
#include "server/service/session_events.h"
#include "server/service/session_guard.h"
#include "server/service/step_times.h"
#include "storage/records.h"

#include <functional>
#include <memory>
#include <optional>
#include <span>
#include <string>
#include <vector>

namespace mapp {

class MapStore;
struct ReplayGuide;

struct MapServiceOptions {
  size_t cache_bytes = size_t{256} << 20;
  RegistrarOptions registrar;
  OptimizerOptions optimizer;
  GuardOptions guard;
  EvidenceLimits evidence;
  /// Greatest upload accepted, bytes.
  size_t max_keyframe_bytes = size_t{64} << 10;
  /// Borrowed; null but where a log is replayed.
  const ReplayGuide* replay = nullptr;
};

/// The map service's logic, free of gRPC: what the handlers of server/rpc call. Thread-safe. Errors are the codes that
/// api/proto documents per call; INVALID_ARGUMENT messages begin with the field's path and a colon.
class MapService {
 public:
  /// Starts registrar and optimizer threads and queues owed optimisations. `store` must outlive the service.
  static StatusOr<std::unique_ptr<MapService>> Create(MapStore& store, const MapServiceOptions& options);
  ~MapService();

  StatusOr<OpenedSession> OpenSession(const CallContext& context, const OpenSessionInput& input);
  /// This and the two calls about a view, FAILED_PRECONDITION: the session is of a single camera (CheckMeasuresDepth).
  StatusOr<AssessedOverlap> AssessOverlap(const CallContext& context, SessionId session, const ViewQuery& view,
                                          int num_samples);
  /// `packet`: codec/keyframe_codec.h. Durable when it returns OK.
  StatusOr<UploadResult> UploadKeyframe(const CallContext& context, const std::string& packet);
  /// Calls `send` with each encoded tile, nearest first; stops with its error.
  StatusOr<SharedMapResult> RequestSharedMap(const CallContext& context, const SharedMapInput& input,
                                             const std::function<Status(const std::string& tile)>& send);
  StatusOr<UpdateResult> ReportUpdate(const CallContext& context, SessionId session,
                                      const std::vector<std::string>& packets);
  /// EvidenceIntake::Take.
  StatusOr<StoredEvidence> ReportEvidence(const CallContext& context, SessionId session, uint32_t number,
                                          const std::string& packet);
  StatusOr<ClosedSession> CloseSession(const CallContext& context, SessionId session);
  /// Delivers the session's present alignment and quarantine at once, if any, then events as they come.
  StatusOr<std::unique_ptr<SessionEvents::Subscription>> WatchSession(const CallContext& context, SessionId session,
                                                                      SessionEvents::Callback callback);

  /// Where the map has the session's keyframes now.
  StatusOr<SessionPoses> GetSessionPoses(const CallContext& context, SessionId session);

  StatusOr<std::vector<MapRecord>> ListMaps(const CallContext& context);
  /// `at`, here and below: the number of a revision, a tag, or nothing for the present state. NOT_FOUND: no such map or
  /// tag; OUT_OF_RANGE: no such revision, or no longer.
  StatusOr<MapState> GetMap(const CallContext& context, const std::string& name, const std::string& at);
  StatusOr<MapRecord> DeleteMap(const CallContext& context, const std::string& name, bool force);
  /// Of one map, or of all with an empty name.
  StatusOr<std::vector<SessionRecord>> ListSessions(const CallContext& context, const std::string& map_name);
  /// Lifts a session's quarantine for good: what was left out of the map enters it, and an open session goes on.
  /// NOT_FOUND; FAILED_PRECONDITION: it is not quarantined.
  StatusOr<ReleasedSession> ReleaseSession(const CallContext& context, SessionId session);
  /// Takes the whole contribution of a session out of the map, which then takes nothing more of it: its frames, the
  /// points that no other session observes, its observations. Closed sessions that shared points with it are optimized
  /// again in the background. ReleaseSession undoes it. With `dry_run` nothing is changed. NOT_FOUND;
  /// FAILED_PRECONDITION: it is quarantined, and nothing of it is in the map.
  StatusOr<RevertedSession> RevertSession(const CallContext& context, SessionId session, const std::string& reason,
                                          bool dry_run);
  /// Forgets a session for good: RevertSession, and then all that it has sent and that is known of it is removed, from
  /// the store's files, too. Points that others observe stay, with a descriptor of theirs. The map's past cannot be
  /// read any more. Stopped in between, it is taken up by calling it again. NOT_FOUND. FAILED_PRECONDITION: it is open,
  /// and `force` is not set. UNAVAILABLE: it is gone from the map, but readers hold the store's log.
  StatusOr<ErasedSession> EraseSession(const CallContext& context, SessionId session, bool force, bool dry_run);
  /// From one snapshot: the map's frames once, then points tile by tile.
  Status ExportMap(const CallContext& context, const std::string& name, const std::string& at,
                   const std::function<Status(const MapRecord&, const std::vector<FrameRecord>&)>& on_frames,
                   const std::function<Status(const std::vector<PointRecord>&)>& on_points);

  /// Optimizer::OptimizeMap of the map of this name.
  StatusOr<MapOptimizationFinished> OptimizeMap(const CallContext& context, const std::string& name,
                                                const MapOptimizationObserver& on_progress);

  /// The latest runs of the map's revisions, newest first.
  StatusOr<RevisionLog> ListRevisions(const CallContext& context, const std::string& name, size_t max_runs);
  /// INVALID_ARGUMENT when `from` is later than `to`.
  StatusOr<MapDiff> DiffRevisions(const CallContext& context, const std::string& name, const std::string& from,
                                  const std::string& to);
  StatusOr<std::vector<TagRecord>> ListTags(const CallContext& context, const std::string& name);
  /// The revision that the tag names now.
  StatusOr<Revision> PutTag(const CallContext& context, const std::string& name, const std::string& tag,
                            const std::string& at);
  Status DeleteTag(const CallContext& context, const std::string& name, const std::string& tag);

  /// CompactMap (compaction.h) of this service's store, now.
  StatusOr<Compaction> CompactMap(const CallContext& context, const CompactionRequest& request,
                                  const CompactionObserver& on_progress);

  /// Looks through the map's history for changes of the world (ScanForChanges) and keeps them (MatchChanges); those
  /// that are at least `auto_accept` sure are accepted, 0: none. FAILED_PRECONDITION: another call does so.
  StatusOr<DetectedChanges> DetectChanges(const CallContext& context, const ChangeSearch& search,
                                          const std::function<void(const ScanProgress&)>& on_progress);
  StatusOr<std::vector<ChangeRecord>> ListChanges(const CallContext& context, const std::string& map_name);
  /// change_decision.h, of changes of this map; devices that hold tiles of it are told.
  StatusOr<ChangeDecision> AcceptChanges(const CallContext& context, const std::string& map_name,
                                         std::span<const ChangeId> ids);
  StatusOr<ChangeDecision> RejectChanges(const CallContext& context, const std::string& map_name,
                                         std::span<const ChangeId> ids);
  StatusOr<ChangeDecision> UndoChanges(const CallContext& context, const std::string& map_name,
                                       std::span<const ChangeId> ids);

  /// ExportBundle (map_bundle.h) from one snapshot: now, or as it was. Errors as GetMap.
  Status ExportBundle(const CallContext& context, const std::string& name, const std::string& at, ByteSink sink,
                      const BundleExportObserver& on_progress);
  /// What ImportBundle would say of the name now: before somebody sends a bundle for nothing.
  Status CheckNameIsFree(const std::string& name);
  /// ImportBundle (map_bundle.h) to this service's store; the map is served when it returns.
  StatusOr<ImportedMap> ImportBundle(const CallContext& context, BundleFile& bundle, const std::string& name,
                                     const BundleImportObserver& on_progress);

  /// Since the service was created.
  std::vector<StepFigures> StepTimesSoFar() const;

  /// Waits until all that was uploaded has been compared with its map, and the optimizations that came due are done.
  void WaitUntilIdle();
  /// Stops the threads. The store stays open. Idempotent.
  void Shutdown();

 private:
  struct Impl;
  explicit MapService(std::unique_ptr<Impl> impl);
  std::unique_ptr<Impl> impl_;
};

}  // namespace mapp
