#include "client_sdk/src/tracker/relocalizer.h"

#include "client_sdk/src/tracker/local_window.h"
#include "vision/robust_estimators.h"

#include <numbers>

namespace mapp::tracker {
namespace {

constexpr size_t kMaxCandidates = 5;
constexpr int kMinPnpInliers = 15;
constexpr double kMaxPnpErrorPx = 4.0;

/// A map that many extended bends over a hundred metres, and alignments are off by degrees at their far end.
constexpr double kMaxCorrectionM = 1.5;
constexpr double kMaxCorrectionRad = 15 * std::numbers::pi / 180;
/// Faster than a runner; cars that park and drones indoors are slower still.
constexpr double kMaxSpeedM_s = 5;

std::vector<OrbDescriptor> DescriptorsOf(std::span<const PointView> points) {
  std::vector<OrbDescriptor> descriptors;
  descriptors.reserve(points.size());
  for (const PointView& point : points) descriptors.push_back(point.descriptor);
  return descriptors;
}

/// Matches with points as queries and the frame's features as train, as RefinePose wants them.
std::vector<Match> MatchPoints(const Frame& frame, std::span<const PointView> points) {
  MatchOptions options;
  options.max_ratio = 0.85;
  std::vector<Match> matches = MatchDescriptors(DescriptorsOf(frame), DescriptorsOf(points), options);
  for (Match& match : matches) std::swap(match.query_idx, match.train_idx);
  return matches;
}

}  // namespace

PoseBound PoseBound::AroundGuess(const Pose3& T_session_camera, double metre) {
  return {T_session_camera, metre * kMaxCorrectionM, kMaxCorrectionRad};
}

PoseBound PoseBound::SinceLost(const Pose3& T_session_camera, double elapsed_s, double metre) {
  return {T_session_camera, metre * (kMaxCorrectionM + kMaxSpeedM_s * elapsed_s), std::numbers::pi};
}

bool PoseBound::Holds(const Pose3& T_session_camera_found) const {
  return Distance(T_session_camera, T_session_camera_found) <= max_distance_m &&
         RotationAngle(T_session_camera, T_session_camera_found) <= max_angle_rad;
}

Relocalizer::Relocalizer(const TrackingCamera& camera, int min_inliers)
    : camera_(camera), min_inliers_(min_inliers), index_(PlaceIndex::Options()) {}

void Relocalizer::AddKeyframe(int keyframe_idx, int generation, const Frame& frame) {
  index_.Add(static_cast<uint64_t>(keyframe_idx), DescriptorsOf(frame));
  keyframes_by_generation_[generation].push_back(keyframe_idx);
}

void Relocalizer::RetireGeneration(int generation) {
  for (const int keyframe_idx : keyframes_by_generation_[generation]) {
    index_.Remove(static_cast<uint64_t>(keyframe_idx));
  }
  keyframes_by_generation_.erase(generation);
}

std::optional<PoseEstimate> Relocalizer::FindAmongKeyframes(const Frame& frame, const SharedSessionMap& shared,
                                                            const PoseBound& bound) const {
  for (const PlaceIndex::Candidate& candidate : index_.Query(DescriptorsOf(frame), kMaxCandidates)) {
    std::vector<PointView> points;
    LocalWindow window;
    {
      MutexLock lock(shared.mutex);
      const MapKeyframe& keyframe = shared.map.keyframe(static_cast<int>(candidate.frame));
      points = CopyPoints(shared.map, keyframe.points);
      const double metre = camera_.MetreAt(shared.map.MedianDepth(static_cast<int>(candidate.frame)));
      window = GatherLocalWindow(shared.map, keyframe.points, keyframe.T_session_camera, metre, keyframe.generation);
    }
    if (auto found = Verify(frame, camera_.own_map, points, window.points, bound)) return found;
  }
  return std::nullopt;
}

std::optional<PoseEstimate> Relocalizer::FindAmongPoints(const Frame& frame, const DepthTrust& trust,
                                                         std::span<const PointView> points,
                                                         const PoseBound& bound) const {
  return Verify(frame, trust, points, points, bound);
}

std::optional<PoseEstimate> Relocalizer::Verify(const Frame& frame, const DepthTrust& trust,
                                                std::span<const PointView> candidates,
                                                std::span<const PointView> all_points, const PoseBound& bound) const {
  const std::vector<Match> matches = MatchPoints(frame, candidates);
  std::vector<Eigen::Vector3d> p_session;
  std::vector<Eigen::Vector2d> pixels;
  for (const Match& match : matches) {
    p_session.push_back(candidates[static_cast<size_t>(match.query_idx)].p_session);
    pixels.push_back(frame.pixels[static_cast<size_t>(match.train_idx)]);
  }
  RansacOptions ransac;
  ransac.min_inliers = kMinPnpInliers;
  const auto pnp = EstimatePose(camera_.pinhole, p_session, pixels, kMaxPnpErrorPx, ransac);
  if (!pnp) return std::nullopt;
  std::vector<Match> supported;
  for (size_t i = 0; i < matches.size(); ++i) {
    if (pnp->inliers[i]) supported.push_back(matches[i]);
  }
  const PoseEstimate refined = RefinePose(frame, camera_, trust, pnp->T_world_camera, candidates, supported);
  if (refined.num_inliers < kMinPnpInliers / 2) return std::nullopt;
  SearchOptions search;
  search.radius_px = 8;
  PoseEstimate guided =
      SearchAndRefine(frame, camera_, trust, refined.T_session_camera, all_points, search, min_inliers_);
  if (guided.num_inliers < min_inliers_ || !bound.Holds(guided.T_session_camera)) return std::nullopt;
  return guided;
}

}  // namespace mapp::tracker
