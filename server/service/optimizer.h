#pragma once

#include "mapp/base/call_context.h"
#include "mapp/base/id.h"
#include "server/service/session_events.h"

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
  /// Free frames beyond the session's own: those sharing at least this many points with it.
  int min_shared_points = 15;
  /// The bound of the work (DESIGN 8): a longer session is optimised in stretches of half as many of its frames.
  int max_free_frames = 200;
  /// Told of what went wrong with a session in the background. May be empty; must not block. A session or map deleted
  /// in the meantime is not an error.
  std::function<void(SessionId, const Status&)> on_error;
  /// Told how long each run took. Borrowed; may be null.
  StepTimes* step_times = nullptr;
};

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
  /// Runs one now, on the caller's thread; one at a time. A fragment that is not in the map is left as it is.
  /// NOT_FOUND: no such session, or deleted meanwhile. CANCELLED or DEADLINE_EXCEEDED of `context`, or on Shutdown:
  /// the optimisation is then still owed.
  StatusOr<OptimizationFinished> OptimizeSession(const CallContext& context, SessionId session);
  /// Cancels the work in hand and ends the thread. Idempotent.
  void Shutdown();

 private:
  struct Impl;
  std::unique_ptr<Impl> impl_;
};

}  // namespace mapp
