#pragma once

#include "eval/metrics/change_metrics.h"
#include "mapp/base/status.h"

#include <cstdint>
#include <stop_token>
#include <string>
#include <vector>

namespace mapp {

/// What a server says has changed in the world of a map.
struct ChangeDetection {
  std::vector<DetectedChange> changes;  ///< boxes in the map's frame; windows are in server time and left out
  uint32_t num_accepted = 0;            ///< by auto_accept
  uint32_t num_sessions_read = 0;       ///< whose keyframes were looked at again
  double seconds = 0;                   ///< as the server measured
};

/// Has the server at `address` look through the history of kEvalMapName, and accept what is at least as sure as
/// `auto_accept` (0: nothing). Errors are the call's; DATA_LOSS: an answer that cannot be. CANCELLED on a stop request.
StatusOr<ChangeDetection> DetectChanges(const std::string& address, const std::stop_token& stop,
                                        double auto_accept = 0);

/// A copy of a fleet's `database` as `folder`/map.db, for a server of its own: detection writes, and the lab may hand
/// the map out again. RESOURCE_EXHAUSTED: it cannot be made.
StatusOr<std::string> CopyDatabase(const std::string& database, const std::string& folder);

/// Moves and turns the camera poses of each session in the map together, by up to `max_m` and `max_rad` in any
/// direction, as if the session had been aligned wrongly by so much all along its way; points stay. `database` must not
/// be open elsewhere.
Status DisplaceSessions(const std::string& database, double max_m, double max_rad, uint64_t seed);

}  // namespace mapp
