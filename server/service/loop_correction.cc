#include "server/service/loop_correction.h"

#include "server/service/duplicate_points.h"
#include "server/service/loop_graph.h"
#include "server/service/optimizer_commit.h"
#include "server/service/session_events.h"
#include "server/service/tile_cache.h"

#include <algorithm>
#include <map>
#include <utility>

namespace mapp {
namespace {

/// Links may be off by so many sigmas afterwards: beyond, they and the loop contradict each other.
constexpr double kMaxLinkError = 5;

/// The change that closes a loop, as a change to the store.
class LoopCorrection {
 public:
  /// All must outlive this. `no_outliers`: there are no observations.
  LoopCorrection(const OptimizerRegion& region, const BundleProblem& adjusted, const std::vector<bool>& no_outliers,
                 SessionId session)
      : region_(region), adjusted_(adjusted), session_(session), commit_(region, adjusted, no_outliers) {}

  /// ABORTED when a frame was moved or taken out of the map meanwhile.
  Status Run(MapWriter& writer) {
    MAPP_RETURN_IF_ERROR(commit_.Run(writer));
    MAPP_RETURN_IF_ERROR(writer.SetCause(commit_.map(), RevisionCause::kLoop, session_));
    const std::map<SessionId, size_t> newest = NewestFrames();
    for (const SessionId session : region_.led_sessions) {
      // It goes on from where its newest frame went.
      MAPP_ASSIGN_OR_RETURN(SessionRecord record, writer.GetSession(session));
      if (!record.T_map_session) continue;
      const size_t idx = newest.at(session);
      const Pose3 T_new_old =
          adjusted_.frames[idx].T_world_camera * region_.problem.frames[idx].T_world_camera.Inverse();
      record.T_map_session = T_new_old * *record.T_map_session;
      MAPP_RETURN_IF_ERROR(writer.UpdateSession(record));
      moved_.push_back(std::move(record));
    }
    return absl::OkStatus();
  }

  void Announce(TileCache& tiles, SessionEvents& events) const {
    tiles.Invalidate(commit_.map(), commit_.touched_tiles());
    events.PublishToMap(commit_.map(), TilesChanged{.keys = commit_.touched_tiles(), .revision = commit_.revision()});
    for (const SessionRecord& session : moved_) {
      if (session.IsQuarantined()) continue;
      events.Publish(session.id, SessionCorrected{.T_map_session = *session.T_map_session,
                                                  .scale_map_session = session.scale_map_session});
    }
  }

 private:
  /// Each session's last frame of the region, by index.
  std::map<SessionId, size_t> NewestFrames() const {
    std::map<SessionId, size_t> newest;
    for (size_t i = 0; i < region_.frames.size(); ++i) {
      const FrameRecord& frame = region_.frames[i];
      const auto [entry, is_first] = newest.try_emplace(frame.session, i);
      if (frame.number > region_.frames[entry->second].number) entry->second = i;
    }
    return newest;
  }

  const OptimizerRegion& region_;
  const BundleProblem& adjusted_;
  const SessionId session_;  ///< whose way came back to where it or another had been
  OptimizerCommit commit_;
  std::vector<SessionRecord> moved_;
};

bool IsClosed(const BundleProblem& adjusted) {
  return std::ranges::all_of(adjusted.relative_poses, [&adjusted](const BundleProblem::RelativePose& link) {
    return LinkError(adjusted, link) < kMaxLinkError;
  });
}

double LargestMotion(const BundleProblem& before, const BundleProblem& after) {
  double largest_m = 0;
  for (size_t i = 0; i < before.frames.size(); ++i) {
    largest_m = std::max(largest_m, Distance(before.frames[i].T_world_camera, after.frames[i].T_world_camera));
  }
  return largest_m;
}

/// One attempt. ABORTED when a frame was moved or taken out of the map meanwhile.
StatusOr<std::optional<ClosedLoop>> TryCloseLoop(MapStore& store, TileCache& tiles, SessionEvents& events,
                                                 const CallContext& context, const Loop& loop) {
  LoopGraph graph;
  {
    MAPP_ASSIGN_OR_RETURN(const std::unique_ptr<MapReader> reader, store.Read());
    MAPP_ASSIGN_OR_RETURN(graph, LoadLoopGraph(context, *reader, loop));
  }
  if (graph.num_matches == 0 || graph.region.num_free_frames() == 0) return std::nullopt;
  BundleProblem adjusted = graph.region.problem;
  const BundleOptions options{.max_iterations = 100,
                              .num_threads = 2,
                              .max_seconds = 20,
                              .is_cancelled = [&context] { return !context.Check().ok(); },
                              .on_iteration = {}};
  MAPP_RETURN_IF_ERROR(AdjustBundle(adjusted, options).status());
  MAPP_RETURN_IF_ERROR(context.Check());
  if (!IsClosed(adjusted)) return std::nullopt;
  const std::vector<bool> no_outliers;
  LoopCorrection correction(graph.region, adjusted, no_outliers, loop.visit.session);
  MAPP_RETURN_IF_ERROR(store.Write(
      context, [&correction](MapWriter& writer) { return correction.Run(writer); },
      [&] { correction.Announce(tiles, events); }));
  return ClosedLoop{adjusted.frames.size(), LargestMotion(graph.region.problem, adjusted), 0};
}

}  // namespace

StatusOr<std::optional<ClosedLoop>> CloseLoop(MapStore& store, TileCache& tiles, SessionEvents& events,
                                              const CallContext& context, const Loop& loop) {
  constexpr int kMaxAttempts = 3;
  for (int attempt = 1;; ++attempt) {
    StatusOr<std::optional<ClosedLoop>> closed = TryCloseLoop(store, tiles, events, context, loop);
    if (!absl::IsAborted(closed.status())) return closed;
    if (attempt == kMaxAttempts) return std::nullopt;
  }
}

StatusOr<uint32_t> FuseVisit(MapStore& store, TileCache& tiles, SessionEvents& events, const CallContext& context,
                             const Loop& loop) {
  std::vector<FrameRecord> visit;
  {
    MAPP_ASSIGN_OR_RETURN(const std::unique_ptr<MapReader> reader, store.Read());
    MAPP_ASSIGN_OR_RETURN(visit, reader->ListFrames(loop.map, loop.visit.session));
  }
  std::erase_if(visit, [&loop](const FrameRecord& frame) { return !frame.in_map || !loop.visit.Contains(frame); });
  return FuseDuplicates(store, tiles, events, context, loop.map, visit);
}

}  // namespace mapp
