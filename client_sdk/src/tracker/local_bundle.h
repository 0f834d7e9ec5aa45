#pragma once

#include "client_sdk/src/tracker/session_map.h"
#include "client_sdk/src/tracker/tracking_camera.h"
#include "mapp/base/status.h"

#include <functional>

namespace mapp::tracker {

struct LocalBundleOptions {
  int window = 10;         ///< keyframes adjusted: the newest and those covisible with it
  int max_fixed = 20;      ///< further observers of their points, held still
  int max_iterations = 6;  ///< the next keyframe's adjustment goes on from here
  std::function<bool()> is_cancelled;
};

/// Adjusts the keyframes around `keyframe_idx` and the points they observe; other observers of these points and points
/// of a shared map are fixed. The lock is held to copy out and to write back only. Observations that do not fit
/// afterwards are removed.
Status AdjustLocalWindow(SharedSessionMap& shared, const TrackingCamera& camera, int keyframe_idx,
                         const LocalBundleOptions& options);

}  // namespace mapp::tracker
