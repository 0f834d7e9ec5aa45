#pragma once

#include "client_sdk/src/tracker/frame.h"
#include "client_sdk/src/tracker/session_map.h"
#include "client_sdk/src/tracker/tracking_camera.h"
#include "mapp/geometry/pose3.h"
#include "vision/matching.h"
#include "vision/pose_optimizer.h"

#include <optional>
#include <span>
#include <vector>

namespace mapp::tracker {

/// How to look for map points in a frame of about known pose.
struct SearchOptions {
  double radius_px = 5.0;        ///< half the search window at octave 0; grows with the octave's scale
  int max_distance = 100;        ///< Hamming; 100 where the pose narrows the search (Mur-Artal et al. 2015)
  double max_ratio = 0.9;        ///< best to second best of the same octave
  double min_view_cosine = 0.5;  ///< seen from within 60 degrees of the point's mean view direction
};

/// Points that should appear in a frame, and the features found for some of them.
struct SearchResult {
  std::vector<int> visible;    ///< indices into the points searched
  std::vector<Match> matches;  ///< query_idx indexes the points searched, train_idx the features
};

/// Where a point should appear, or nullopt when it is behind the camera, outside the image, or seen from elsewhere.
std::optional<ProjectedPoint> ProjectPoint(const PointView& point, const TrackingCamera& camera,
                                           const Pose3& T_session_camera, const SearchOptions& options);

SearchResult SearchByProjection(const Frame& frame, const TrackingCamera& camera, const Pose3& T_session_camera,
                                std::span<const PointView> points, const SearchOptions& options);

/// A frame's pose with the map points that support it.
struct PoseEstimate {
  Pose3 T_session_camera;
  std::vector<int> points;  ///< per feature of the frame: point_idx, or kNone
  int num_inliers = 0;
};

/// Refines a pose on matches between points and features (query_idx indexes `points`, train_idx the frame's features).
/// Without enough support the guess is returned with no inliers.
PoseEstimate RefinePose(const Frame& frame, const TrackingCamera& camera, const DepthTrust& trust,
                        const Pose3& T_session_camera_guess, std::span<const PointView> points,
                        std::span<const Match> matches);

/// Searches around a guess and refines, first in the given window and, when fewer than `min_inliers` agree, once more
/// in one twice as wide.
PoseEstimate SearchAndRefine(const Frame& frame, const TrackingCamera& camera, const DepthTrust& trust,
                             const Pose3& T_session_camera_guess, std::span<const PointView> points,
                             SearchOptions options, int min_inliers);

}  // namespace mapp::tracker
