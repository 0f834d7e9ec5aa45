#include "client_sdk/src/tracker/point_search.h"

#include <utility>

namespace mapp::tracker {

std::optional<ProjectedPoint> ProjectPoint(const PointView& point, const TrackingCamera& camera,
                                           const Pose3& T_session_camera, const SearchOptions& options) {
  const Eigen::Vector3d ray = point.p_session - T_session_camera.translation();
  const Eigen::Vector3d p_camera = T_session_camera.rotation().conjugate() * ray;
  if (p_camera.z() < camera.min_point_depth_m) return std::nullopt;
  const Eigen::Vector2d pixel = camera.pinhole.Project(p_camera);
  if (!camera.Contains(pixel)) return std::nullopt;
  const double distance_m = ray.norm();
  if (ray.dot(point.view_direction.cast<double>()) < options.min_view_cosine * distance_m) return std::nullopt;
  ProjectedPoint projected;
  projected.u_px = static_cast<float>(pixel.x());
  projected.v_px = static_cast<float>(pixel.y());
  projected.octave = PredictOctave(point.reference_distance_m, static_cast<float>(distance_m));
  projected.radius_px = static_cast<float>(options.radius_px) * OctaveScale(projected.octave);
  projected.descriptor = point.descriptor;
  return projected;
}

SearchResult SearchByProjection(const Frame& frame, const TrackingCamera& camera, const Pose3& T_session_camera,
                                std::span<const PointView> points, const SearchOptions& options) {
  SearchResult result;
  std::vector<ProjectedPoint> projected;
  for (size_t i = 0; i < points.size(); ++i) {
    const std::optional<ProjectedPoint> candidate = ProjectPoint(points[i], camera, T_session_camera, options);
    if (!candidate) continue;
    projected.push_back(*candidate);
    result.visible.push_back(static_cast<int>(i));
  }
  MatchOptions match_options;
  match_options.max_distance = options.max_distance;
  match_options.max_ratio = options.max_ratio;
  result.matches = MatchProjected(projected, frame.grid, frame.features, match_options);
  for (Match& match : result.matches) match.query_idx = result.visible[static_cast<size_t>(match.query_idx)];
  return result;
}

PoseEstimate RefinePose(const Frame& frame, const TrackingCamera& camera, const DepthTrust& trust,
                        const Pose3& T_session_camera_guess, std::span<const PointView> points,
                        std::span<const Match> matches) {
  std::vector<PoseObservation> observations;
  observations.reserve(matches.size());
  for (const Match& match : matches) {
    const auto feature = static_cast<size_t>(match.train_idx);
    PoseObservation observation;
    const PointView& point = points[static_cast<size_t>(match.query_idx)];
    observation.p_world = point.p_session;
    observation.pixel = frame.pixels[feature];
    observation.sigma_px = static_cast<double>(OctaveScale(frame.features[feature].keypoint.octave));
    if (!point.from_server || trust.applies_to_server_points) {
      observation.depth_m = static_cast<double>(frame.depths_m[feature]);
    }
    observations.push_back(observation);
  }
  PoseOptions options;
  options.bf_px_m = trust.bf_px_m;
  options.chi2_depth = trust.chi2;
  const PoseResult refined = OptimizePose(camera.pinhole, observations, T_session_camera_guess, options);

  PoseEstimate estimate;
  estimate.T_session_camera = T_session_camera_guess;
  estimate.points.assign(frame.size(), kNone);
  if (!refined.converged) return estimate;
  estimate.T_session_camera = refined.T_world_camera;
  estimate.num_inliers = refined.num_inliers;
  for (size_t i = 0; i < matches.size(); ++i) {
    if (!refined.inliers[i]) continue;
    estimate.points[static_cast<size_t>(matches[i].train_idx)] =
        points[static_cast<size_t>(matches[i].query_idx)].point_idx;
  }
  return estimate;
}

PoseEstimate SearchAndRefine(const Frame& frame, const TrackingCamera& camera, const DepthTrust& trust,
                             const Pose3& T_session_camera_guess, std::span<const PointView> points,
                             SearchOptions options, int min_inliers) {
  PoseEstimate best;
  best.T_session_camera = T_session_camera_guess;
  best.points.assign(frame.size(), kNone);
  for (int attempt = 0; attempt < 2; ++attempt) {
    const SearchResult found = SearchByProjection(frame, camera, T_session_camera_guess, points, options);
    PoseEstimate estimate = RefinePose(frame, camera, trust, T_session_camera_guess, points, found.matches);
    if (attempt == 0 || estimate.num_inliers > best.num_inliers) best = std::move(estimate);
    if (best.num_inliers >= min_inliers) break;
    options.radius_px *= 2;
  }
  return best;
}

}  // namespace mapp::tracker
