#pragma once

#include "mapp/base/call_context.h"
#include "mapp/base/id.h"
#include "server/service/session_events.h"

#include <cstdint>
#include <functional>
#include <memory>

namespace mapp {

class MapStore;
class StepTimes;
class TileCache;

struct OptimizerOptions {
  int max_iterations = 20;
  int num_threads = 2;
  double max_seconds = 60;
  /// The same for a whole map, which only an operator asks for.
  int max_map_iterations = 50;
  double max_map_seconds = 600;
  int max_map_rounds = 4;
  /// Free frames beyond the session's own: those sharing at least this many points with it.
  int min_shared_points = 15;
  /// The bound of the work (DESIGN 8): a longer session is optimised in stretches of half as many of its frames. What
  /// of the session lies outside a stretch stays where it has drifted to, and holds the stretch there.
  int max_free_frames = 600;
  /// Told of what went wrong with a session in the background. May be empty; must not block. A session or map deleted
  /// in the meantime is not an error.
  std::function<void(SessionId, const Status&)> on_error;
  /// Told how long each run took. Borrowed; may be null.
  StepTimes* step_times = nullptr;
};

/// What came of the optimisation of a whole map.
struct MapOptimizationFinished {
  OptimizationFinished adjustment;  ///< over all rounds
  uint32_t num_rounds = 0;
  uint32_t num_fused = 0;  ///< points that turned out to be another one
};

/// How far the optimisation of a whole map has come.
struct MapOptimizationProgress {
  uint32_t round = 0;       ///< of adjusting; between rounds, points that turn out to be one are fused
  uint32_t num_frames = 0;  ///< that are adjusted
  uint32_t num_points = 0;
  uint32_t pass = 0;  ///< 0: with all observations, 1: without those that did not fit
  uint32_t num_iterations = 0;
  double cost = 0;  ///< half the sum of the robustified squared residuals
};
using MapOptimizationObserver = std::function<void(const MapOptimizationProgress&)>;

/// Bounded bundle adjustment around what a session brought (DESIGN 8), in a thread of its own: on a snapshot, while the
/// service answers; a result that made the residuals worse is dropped. Thread-safe.
class Optimizer {
 public:
  Optimizer(MapStore& store, TileCache& tiles, SessionEvents& events, const OptimizerOptions& options);
  ~Optimizer();

  /// Queues the session's optimisation; returns at once. Publishes OptimizationFinished to the session.
  void OnSessionClosed(SessionId session);
  /// Queues the closed sessions whose optimisation is still owed (after a start). Fragments are owed none.
  Status ResumeOwed();
  /// Waits until the queued ones are done.
  void WaitUntilIdle();
  /// Runs one now, on the caller's thread; one at a time. A fragment that is not in the map is left as it is.
  /// NOT_FOUND: no such session, or deleted meanwhile. CANCELLED or DEADLINE_EXCEEDED of `context`, or on Shutdown:
  /// the optimisation is then still owed.
  StatusOr<OptimizationFinished> OptimizeSession(const CallContext& context, SessionId session);
  /// Adjusts all frames and points of a map together, fuses points that turn out to be one, and adjusts again while
  /// that finds more; on the caller's thread; waits for an optimisation that is under way. Tells `on_progress` (may be
  /// empty) in each round once what there is to adjust is known, and after every iteration. A round that would make the
  /// map worse is not applied. NOT_FOUND: no such map. CANCELLED or DEADLINE_EXCEEDED of `context`, or on Shutdown: the
  /// map is as the round before left it. ABORTED: frames go on being moved or taken out meanwhile; ask again.
  StatusOr<MapOptimizationFinished> OptimizeMap(const CallContext& context, MapId map,
                                                const MapOptimizationObserver& on_progress);
  /// Cancels the work in hand and ends the thread. Idempotent.
  void Shutdown();

 private:
  struct Impl;
  std::unique_ptr<Impl> impl_;
};

}  // namespace mapp
