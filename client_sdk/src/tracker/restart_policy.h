#pragma once

#include "mapp/client/orb_tracker.h"

#include <cstdint>
#include <optional>

namespace mapp::tracker {

/// Decides when a lost tracker has searched its map for long enough and had better begin another. Tracking thread only.
class RestartPolicy {
 public:
  explicit RestartPolicy(const OrbTrackerOptions& options) : options_(options) {}

  /// What one frame came to.
  struct Outcome {
    int64_t stamp_ns = 0;
    bool lost = false;
    bool can_start = false;  ///< a map could begin at this frame; read only when lost
    int num_keyframes = 0;   ///< of the map that was searched
  };
  /// To be told of every frame. True when a new map should begin at this one.
  bool IsDue(const Outcome& outcome);

 private:
  const OrbTrackerOptions options_;
  std::optional<int64_t> last_stamp_ns_;
  int64_t searched_ns_ = 0;
};

}  // namespace mapp::tracker
