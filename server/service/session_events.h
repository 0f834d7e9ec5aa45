#pragma once

#include "mapp/base/id.h"
#include "mapp/base/mutex.h"
#include "mapp/geometry/pose3.h"
#include "mapp/map/tile.h"

#include <cstdint>
#include <functional>
#include <map>
#include <memory>
#include <string>
#include <variant>
#include <vector>

namespace mapp {

struct AlignmentTried {
  uint32_t keyframe = 0;
  uint32_t num_candidates = 0;
  uint32_t num_inliers = 0;
  uint32_t num_consistent = 0;
};
struct SessionAligned {
  Pose3 T_map_session;
  uint32_t keyframe = 0;
  double scale_map_session = 1;  ///< SessionRecord::scale_map_session
};
struct SessionCorrected {
  Pose3 T_map_session;
  double scale_map_session = 1;
};
struct TilesChanged {
  std::vector<TileKey> keys;
  Revision revision;
};
struct OptimizationFinished {
  bool applied = false;
  double initial_rmse_px = 0;
  double final_rmse_px = 0;
  uint32_t num_frames = 0;
  uint32_t num_points = 0;
  double seconds = 0;
};
/// Nothing of the session enters the map any more.
struct SessionQuarantined {
  std::string reason;
};
/// An operator has lifted that.
struct SessionReleased {};
using SessionEvent = std::variant<AlignmentTried, SessionAligned, SessionCorrected, TilesChanged, OptimizationFinished,
                                  SessionQuarantined, SessionReleased>;

/// Who listens to which session. Thread-safe. Callbacks run on the publisher's thread, must not block and must not
/// call back into this object.
class SessionEvents {
 public:
  using Callback = std::function<void(const SessionEvent&)>;
  /// Unsubscribes when destroyed; after that the callback is not running and will not run.
  class Subscription {
   public:
    ~Subscription();

   private:
    friend class SessionEvents;
    SessionEvents* events_ = nullptr;
    uint64_t id_ = 0;
  };

  [[nodiscard]] std::unique_ptr<Subscription> Subscribe(SessionId session, MapId map, Callback callback);
  void Publish(SessionId session, const SessionEvent& event);
  /// To every listener of the map's sessions.
  void PublishToMap(MapId map, const SessionEvent& event);

 private:
  struct Listener {
    SessionId session;
    MapId map;
    Callback callback;
  };
  Mutex mutex_;
  uint64_t next_id_ ABSL_GUARDED_BY(mutex_) = 1;
  std::map<uint64_t, Listener> listeners_ ABSL_GUARDED_BY(mutex_);
};

}  // namespace mapp
