#pragma once

#include "client_sdk/src/tracker/session_map.h"
#include "client_sdk/src/tracker/tracking_camera.h"

#include <vector>

namespace mapp::tracker {

/// Makes points from features without depth that match between a keyframe and its neighbors: what lies beyond the depth
/// sensor's range or at its blind spots. Matches must obey the epipolar line, see the point under at least about one
/// degree of parallax, and reproject within the chi-square bound in both images. Returns the points made.
std::vector<int> TriangulateWithNeighbors(SharedSessionMap& shared, const TrackingCamera& camera, int keyframe_idx,
                                          const std::vector<int>& neighbors);

}  // namespace mapp::tracker
