#include "server/service/optimizer.h"

#include "server/service/duplicate_points.h"
#include "server/service/optimizer_commit.h"
#include "server/service/optimizer_region.h"
#include "server/service/serial_worker.h"
#include "server/service/step_times.h"
#include "server/service/tile_cache.h"

#include <algorithm>
#include <atomic>
#include <chrono>
#include <numbers>

namespace mapp {
namespace {

/// Closed sessions that may wait; what does not fit stays owed and is taken up after the next start.
constexpr size_t kMaxWaitingSessions = 1024;
/// A frame that moved further than this was not refined but torn away: the result is dropped.
constexpr double kMaxFrameMotionM = 0.5;
constexpr double kMaxFrameTurnRad = 10.0 * std::numbers::pi / 180.0;
/// An adjustment is begun so often when what it works on is moved meanwhile.
constexpr int kMaxAttempts = 3;
/// Fusing fewer of a map's points than this is not worth another round of adjusting them all.
constexpr double kMinFusedShare = 0.005;

using Clock = std::chrono::steady_clock;

double SecondsSince(Clock::time_point start) { return std::chrono::duration<double>(Clock::now() - start).count(); }

bool IsPlausible(const BundleProblem& before, const BundleProblem& after) {
  for (size_t i = 0; i < before.frames.size(); ++i) {
    const Pose3& moved = after.frames[i].T_world_camera;
    if (!moved.IsFinite() || Distance(before.frames[i].T_world_camera, moved) > kMaxFrameMotionM ||
        RotationAngle(before.frames[i].T_world_camera, moved) > kMaxFrameTurnRad) {
      return false;
    }
  }
  return true;
}

/// Called after every iteration with the pass, the iterations of it so far and the cost. May be empty.
using PassObserver = std::function<void(uint32_t, uint32_t, double)>;

/// Adjusts, leaves out what did not fit, and adjusts again. Per observation, whether it was left out in the end.
StatusOr<std::vector<bool>> AdjustTwice(BundleProblem& problem, BundleOptions options, const PassObserver& on_pass) {
  uint32_t pass = 0;
  if (on_pass) {
    options.on_iteration = [&](int iteration, double cost) { on_pass(pass, static_cast<uint32_t>(iteration), cost); };
  }
  const Clock::time_point start = Clock::now();
  MAPP_ASSIGN_OR_RETURN(const BundleResult first, AdjustBundle(problem, options));
  std::vector<bool> outliers = first.outliers;

  BundleProblem fitting = problem;
  fitting.observations.clear();
  std::vector<size_t> fitting_indices;
  for (size_t i = 0; i < problem.observations.size(); ++i) {
    if (outliers[i]) continue;
    fitting.observations.push_back(problem.observations[i]);
    fitting_indices.push_back(i);
  }
  options.max_seconds -= SecondsSince(start);
  if (fitting.observations.empty() || options.max_seconds <= 0) return outliers;
  pass = 1;
  MAPP_ASSIGN_OR_RETURN(const BundleResult second, AdjustBundle(fitting, options));
  for (size_t i = 0; i < fitting_indices.size(); ++i) {
    if (second.outliers[i]) outliers[fitting_indices[i]] = true;
  }
  problem.frames = std::move(fitting.frames);
  problem.points = std::move(fitting.points);
  return outliers;
}

}  // namespace

struct Optimizer::Impl {
  Impl(MapStore& map_store, TileCache& tile_cache, SessionEvents& session_events, const OptimizerOptions& opts)
      : store(map_store),
        tiles(tile_cache),
        events(session_events),
        options(opts),
        worker(kMaxWaitingSessions, [this](const SessionId& session) { RunQueued(session); }) {}

  void RunQueued(SessionId session);
  StatusOr<OptimizationFinished> Optimize(const CallContext& context, SessionId session);
  StatusOr<MapOptimizationFinished> OptimizeMap(const CallContext& context, MapId map,
                                                const MapOptimizationObserver& on_progress);
  /// One round of it, within `limits`.
  Status OptimizeAll(const CallContext& context, MapId map, OptimizerOptions limits,
                     const MapOptimizationObserver& on_progress, OptimizationFinished& finished);
  StatusOr<std::vector<FrameRecord>> FramesOf(MapId map) const;
  /// Adjusts what is around these frames within `limits`; adds its figures to `finished`. Begins anew when a frame was
  /// moved meanwhile: a loop was closed, say. ABORTED when that goes on.
  Status OptimizeAround(const CallContext& context, std::span<const FrameRecord> frames, const OptimizerOptions& limits,
                        const MapOptimizationObserver& on_progress, OptimizationFinished& finished);
  /// One attempt at it. ABORTED as Commit.
  Status TryOptimizeAround(const CallContext& context, std::span<const FrameRecord> frames,
                           const OptimizerOptions& limits, const MapOptimizationObserver& on_progress,
                           OptimizationFinished& finished);
  /// ABORTED when a frame of the region was moved or taken out of the map meanwhile.
  Status Commit(const CallContext& context, const OptimizerRegion& region, const BundleProblem& adjusted,
                const std::vector<bool>& outliers, std::optional<SessionId> cause);
  Status RecordOptimized(const CallContext& context, SessionId session);
  /// `context` that also ends on Shutdown.
  CallContext Stoppable(const CallContext& context) const;

  MapStore& store;
  TileCache& tiles;
  SessionEvents& events;
  const OptimizerOptions options;
  std::atomic<bool> stopping = false;
  Mutex run_mutex;                 ///< one optimisation at a time: two would overwrite each other
  SerialWorker<SessionId> worker;  ///< last: its thread uses all of the above
};

CallContext Optimizer::Impl::Stoppable(const CallContext& context) const {
  CallContext stoppable = context;
  stoppable.is_cancelled = [this, inner = context.is_cancelled] { return stopping || (inner && inner()); };
  return stoppable;
}

Status Optimizer::Impl::Commit(const CallContext& context, const OptimizerRegion& region, const BundleProblem& adjusted,
                               const std::vector<bool>& outliers, std::optional<SessionId> cause) {
  OptimizerCommit commit(region, adjusted, outliers);
  return store.Write(
      context,
      [&](MapWriter& writer) -> Status {
        MAPP_RETURN_IF_ERROR(commit.Run(writer));
        return writer.SetCause(commit.map(), RevisionCause::kOptimization, cause);
      },
      [&] {
        tiles.Invalidate(commit.map(), commit.touched_tiles());
        events.PublishToMap(commit.map(), TilesChanged{.keys = commit.touched_tiles(), .revision = commit.revision()});
      });
}

Status Optimizer::Impl::OptimizeAround(const CallContext& context, std::span<const FrameRecord> frames,
                                       const OptimizerOptions& limits, const MapOptimizationObserver& on_progress,
                                       OptimizationFinished& finished) {
  const Clock::time_point start = Clock::now();
  for (int attempt = 1;; ++attempt) {
    OptimizationFinished tried = finished;
    OptimizerOptions left = limits;
    left.max_seconds -= SecondsSince(start);
    const Status status = TryOptimizeAround(context, frames, left, on_progress, tried);
    if (absl::IsAborted(status) && attempt < kMaxAttempts && SecondsSince(start) < limits.max_seconds) continue;
    if (status.ok()) finished = tried;
    return status;
  }
}

Status Optimizer::Impl::TryOptimizeAround(const CallContext& context, std::span<const FrameRecord> frames,
                                          const OptimizerOptions& limits, const MapOptimizationObserver& on_progress,
                                          OptimizationFinished& finished) {
  OptimizerRegion region;
  {
    MAPP_ASSIGN_OR_RETURN(const std::unique_ptr<MapReader> reader, store.Read());
    MAPP_ASSIGN_OR_RETURN(region, LoadOptimizerRegion(context, *reader, frames, limits));
  }
  const auto num_free = static_cast<uint32_t>(region.num_free_frames());
  const auto num_points = static_cast<uint32_t>(region.points.size());
  PassObserver on_pass;
  if (on_progress) {
    on_progress({.num_frames = num_free, .num_points = num_points});
    on_pass = [&](uint32_t pass, uint32_t iteration, double cost) {
      on_progress(
          {.num_frames = num_free, .num_points = num_points, .pass = pass, .num_iterations = iteration, .cost = cost});
    };
  }
  if (num_free == 0) return absl::OkStatus();

  BundleProblem adjusted = region.problem;
  const BundleOptions bundle_options{.max_iterations = limits.max_iterations,
                                     .num_threads = limits.num_threads,
                                     .max_seconds = limits.max_seconds,
                                     .is_cancelled = [&context] { return !context.Check().ok(); },
                                     .on_iteration = {}};
  MAPP_ASSIGN_OR_RETURN(const std::vector<bool> outliers, AdjustTwice(adjusted, bundle_options, on_pass));
  MAPP_RETURN_IF_ERROR(context.Check());

  const double before_px = ReprojectionRmse(region.problem);
  const double after_px = ReprojectionRmse(adjusted);
  finished.initial_rmse_px = std::max(finished.initial_rmse_px, before_px);
  finished.final_rmse_px = std::max(finished.final_rmse_px, after_px);
  finished.num_frames += num_free;
  finished.num_points += num_points;
  if (after_px >= before_px || !IsPlausible(region.problem, adjusted)) return absl::OkStatus();
  MAPP_RETURN_IF_ERROR(Commit(context, region, adjusted, outliers, SoleSession(frames)));
  finished.applied = true;
  return absl::OkStatus();
}

Status Optimizer::Impl::RecordOptimized(const CallContext& context, SessionId session) {
  return store.Write(context, [session](MapWriter& writer) -> Status {
    MAPP_ASSIGN_OR_RETURN(SessionRecord record, writer.GetSession(session));
    MAPP_ASSIGN_OR_RETURN(const MapRecord map, writer.GetMap(record.map));
    record.optimized = map.revision;
    return writer.UpdateSession(record);
  });
}

StatusOr<OptimizationFinished> Optimizer::Impl::Optimize(const CallContext& context, SessionId session) {
  const MutexLock lock(run_mutex);
  const Clock::time_point start = Clock::now();
  OptimizationFinished finished;
  std::vector<FrameRecord> frames;
  {
    MAPP_ASSIGN_OR_RETURN(const std::unique_ptr<MapReader> reader, store.Read());
    MAPP_ASSIGN_OR_RETURN(const SessionRecord record, reader->GetSession(session));
    if (!record.T_map_session) return finished;
    MAPP_ASSIGN_OR_RETURN(frames, reader->ListFrames(record.map, session));
  }
  std::erase_if(frames, [](const FrameRecord& frame) { return !frame.in_map; });
  const auto max_free_frames = static_cast<size_t>(std::max(1, options.max_free_frames));
  const size_t stretch = frames.size() <= max_free_frames ? max_free_frames : std::max<size_t>(1, max_free_frames / 2);
  for (size_t first = 0; first < frames.size(); first += stretch) {
    const double seconds_left = options.max_seconds - SecondsSince(start);
    if (seconds_left <= 0) break;
    const std::span<const FrameRecord> part =
        std::span(frames).subspan(first, std::min(stretch, frames.size() - first));
    OptimizerOptions limits = options;
    limits.max_seconds = seconds_left;
    const Status status = OptimizeAround(context, part, limits, {}, finished);
    // ABORTED: somebody else moved these frames, and their word is newer than this snapshot's.
    if (!absl::IsAborted(status)) MAPP_RETURN_IF_ERROR(status);
  }
  MAPP_RETURN_IF_ERROR(RecordOptimized(context, session));
  finished.seconds = SecondsSince(start);
  if (options.step_times != nullptr) options.step_times->Add(ServiceStep::kOptimization, Clock::now() - start);
  events.Publish(session, finished);
  return finished;
}

StatusOr<std::vector<FrameRecord>> Optimizer::Impl::FramesOf(MapId map) const {
  MAPP_ASSIGN_OR_RETURN(const std::unique_ptr<MapReader> reader, store.Read());
  MAPP_RETURN_IF_ERROR(reader->GetMap(map).status());
  MAPP_ASSIGN_OR_RETURN(std::vector<FrameRecord> frames, reader->ListFrames(map, std::nullopt));
  std::erase_if(frames, [](const FrameRecord& frame) { return !frame.in_map; });
  return frames;
}

Status Optimizer::Impl::OptimizeAll(const CallContext& context, MapId map, OptimizerOptions limits,
                                    const MapOptimizationObserver& on_progress, OptimizationFinished& finished) {
  MAPP_ASSIGN_OR_RETURN(const std::vector<FrameRecord> frames, FramesOf(map));
  limits.max_free_frames = static_cast<int>(frames.size());
  return OptimizeAround(context, frames, limits, on_progress, finished);
}

StatusOr<MapOptimizationFinished> Optimizer::Impl::OptimizeMap(const CallContext& context, MapId map,
                                                               const MapOptimizationObserver& on_progress) {
  const MutexLock lock(run_mutex);
  const Clock::time_point start = Clock::now();
  OptimizerOptions limits = options;
  limits.max_iterations = options.max_map_iterations;
  MapOptimizationFinished all;
  for (int round = 0; round < options.max_map_rounds; ++round) {
    if (round > 0) {
      MAPP_ASSIGN_OR_RETURN(const std::vector<FrameRecord> frames, FramesOf(map));
      MAPP_ASSIGN_OR_RETURN(const uint32_t num_fused, FuseDuplicates(store, tiles, events, context, map, frames));
      all.num_fused += num_fused;
      if (num_fused < kMinFusedShare * all.adjustment.num_points) break;
    }
    limits.max_seconds = options.max_map_seconds - SecondsSince(start);
    if (limits.max_seconds <= 0) break;
    MapOptimizationObserver tell;
    if (on_progress) {
      tell = [&](MapOptimizationProgress progress) {
        progress.round = static_cast<uint32_t>(round);
        on_progress(progress);
      };
    }
    OptimizationFinished one;
    MAPP_RETURN_IF_ERROR(OptimizeAll(context, map, limits, tell, one));
    ++all.num_rounds;
    one.applied |= all.adjustment.applied;
    if (round > 0) one.initial_rmse_px = all.adjustment.initial_rmse_px;
    all.adjustment = one;
  }
  all.adjustment.seconds = SecondsSince(start);
  return all;
}

void Optimizer::Impl::RunQueued(SessionId session) {
  const Status status = Optimize(Stoppable({}), session).status();
  if (status.ok() || stopping || absl::IsNotFound(status)) return;
  events.Publish(session, OptimizationFinished{});
  if (options.on_error) options.on_error(session, status);
}

Optimizer::Optimizer(MapStore& store, TileCache& tiles, SessionEvents& events, const OptimizerOptions& options)
    : impl_(std::make_unique<Impl>(store, tiles, events, options)) {}

Optimizer::~Optimizer() { Shutdown(); }

void Optimizer::OnSessionClosed(SessionId session) { impl_->worker.Push(session); }

Status Optimizer::ResumeOwed() {
  MAPP_ASSIGN_OR_RETURN(const std::unique_ptr<MapReader> reader, impl_->store.Read());
  MAPP_ASSIGN_OR_RETURN(const std::vector<SessionRecord> sessions, reader->ListSessions(std::nullopt));
  for (const SessionRecord& session : sessions) {
    if (session.closed_ns && session.T_map_session && !session.optimized) impl_->worker.Push(session.id);
  }
  return absl::OkStatus();
}

StatusOr<OptimizationFinished> Optimizer::OptimizeSession(const CallContext& context, SessionId session) {
  return impl_->Optimize(impl_->Stoppable(context), session);
}

StatusOr<MapOptimizationFinished> Optimizer::OptimizeMap(const CallContext& context, MapId map,
                                                         const MapOptimizationObserver& on_progress) {
  return impl_->OptimizeMap(impl_->Stoppable(context), map, on_progress);
}

void Optimizer::WaitUntilIdle() { impl_->worker.WaitUntilIdle(); }

void Optimizer::Shutdown() {
  impl_->stopping = true;
  impl_->worker.Stop();
}

}  // namespace mapp
