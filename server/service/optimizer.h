#pragma once

#include <memory>

#include "mapp/base/call_context.h"
#include "mapp/base/id.h"
#include "server/service/session_events.h"

namespace mapp {

class MapStore;
class TileCache;

struct OptimizerOptions {
  int max_iterations = 20;
  int num_threads = 2;
  double max_seconds = 60;
  /// Free frames beyond the session's own: those sharing at least this many points with it.
  int min_shared_points = 15;
  int max_free_frames = 200;  ///< the bound of the work (DESIGN 8)
};

/// Bounded bundle adjustment around what a session brought (DESIGN 8), in a thread of its own: on a snapshot, while the
/// service answers; a result that made the residuals worse is dropped. Thread-safe.
class Optimizer {
 public:
  Optimizer(MapStore& store, TileCache& tiles, SessionEvents& events, const OptimizerOptions& options);
  ~Optimizer();

  /// Queues the session's optimisation; returns at once. Publishes OptimizationFinished to the session.
  void OnSessionClosed(SessionId session);
  /// Queues the closed sessions whose optimisation is still owed (after a start).
  Status ResumeOwed();
  /// Runs one now, on the caller's thread.
  StatusOr<OptimizationFinished> OptimizeSession(const CallContext& context, SessionId session);
  /// Cancels the work in hand and ends the thread. Idempotent.
  void Shutdown();

 private:
  struct Impl;
  std::unique_ptr<Impl> impl_;
};

}  // namespace mapp
