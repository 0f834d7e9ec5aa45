#pragma once

#include "client_sdk/src/tracker/session_map.h"
#include "client_sdk/src/tracker/tracking_camera.h"

#include <vector>

namespace mapp::tracker {

/// Finds, in both directions, the points of a keyframe in its neighbors' images: adds the observation where the feature
/// has no point, and fuses the two points where it has another one near the same place. Of two points a shared one
/// stays, else the one observed more often. Matching runs on copies, without the lock.
void FuseWithNeighbors(SharedSessionMap& shared, const TrackingCamera& camera, int keyframe_idx,
                       const std::vector<int>& neighbors);

/// Keyframes to compare with: covisible ones, and those standing nearby that look the same way.
std::vector<int> FusionNeighbors(const SessionMap& map, const TrackingCamera& camera, int keyframe_idx,
                                 size_t max_neighbors);

}  // namespace mapp::tracker
