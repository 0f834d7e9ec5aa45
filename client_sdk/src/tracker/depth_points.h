#pragma once

#include "client_sdk/src/tracker/frame.h"
#include "client_sdk/src/tracker/session_map.h"
#include "client_sdk/src/tracker/tracking_camera.h"
#include "mapp/geometry/pose3.h"

#include <cstddef>
#include <span>
#include <vector>

namespace mapp::tracker {

/// Whether the feature's depth is good enough for a point from this frame alone.
bool HasUsableDepth(const Frame& frame, size_t feature, const TrackingCamera& camera);

/// Features that become points from this frame alone, in order: those of usable depth, and where these are few, the
/// nearest ones up to three times as far, up to 100 in all (Mur-Artal and Tardos 2017 do so too). Without them a device
/// that looks at nothing near would have no map.
std::vector<size_t> FeaturesForPoints(const Frame& frame, const TrackingCamera& camera);

/// Position of a feature with depth, in the session's frame.
Eigen::Vector3d DepthPoint(const Frame& frame, size_t feature, const TrackingCamera& camera,
                           const Pose3& T_session_camera);

/// FeaturesForPoints() as points to search for, not in the map (their point_idx is kNone). Features
/// that have a map point in `points` (one entry per feature, or empty) are left out.
std::vector<PointView> DepthPointViews(const Frame& frame, const TrackingCamera& camera, const Pose3& T_session_camera,
                                       std::span<const int> points);

}  // namespace mapp::tracker
