#include "server/service/alignment_projection.h"

#include "server/service/median.h"
#include "vision/pose_optimizer.h"

#include <algorithm>
#include <bitset>
#include <cmath>
#include <numbers>
#include <unordered_set>

namespace mapp {
namespace {

/// Points seen from further aside than this look different to ORB (the views at which matching broke down on the
/// kitchen sequences).
const double kMinViewCosine = std::cos(60.0 * std::numbers::pi / 180.0);
/// Within this angle, ORB finds most points again.
const double kAlikeCosine = std::cos(20.0 * std::numbers::pi / 180.0);
constexpr double kFirstRadiusPx = 12;
constexpr double kFinalRadiusPx = 6;
constexpr int kMinMatches = 12;
/// Triangulated depths may be off by this share: a third of a pixel over the least parallax, a degree and a bit, at
/// which most points stand (docs/decisions/0014).
constexpr double kTriangulatedShare = 0.15;
/// Depths that have to tell a scale, and the share of them that has to agree on it.
constexpr size_t kMinScales = 10;
constexpr double kMinNearMedian = 0.5;
constexpr MatchOptions kGuidedMatching = {.max_distance = 64, .max_ratio = 0.9, .mutual = true};

constexpr double kNeighbourRangeM = 5.0;
const double kNeighbourCosine = std::cos(60.0 * std::numbers::pi / 180.0);
constexpr size_t kMaxNeighbourFrames = 16;
/// Metres that a full turn away counts for when neighbours are ranked.
constexpr double kMetersPerOppositeView = 4.0;

struct Candidate {
  int point_idx = 0;
  ProjectedPoint projected;
};

std::vector<Candidate> ProjectVisible(const QueryKeyframe& query, std::span<const PointRecord> points,
                                      const Pose3& T_map_camera, double radius_px) {
  const Pose3 T_camera_map = T_map_camera.Inverse();
  const FrameView& view = query.view();
  const double focal_px = view.camera.MeanFocalPx();
  std::vector<Candidate> visible;
  for (size_t i = 0; i < points.size(); ++i) {
    const PointRecord& point = points[i];
    const Eigen::Vector3d p_camera = T_camera_map * point.position;
    if (p_camera.z() < kMinDepthM) continue;
    const Eigen::Vector2d pixel = view.pinhole.Project(p_camera);
    if (!view.camera.Contains(pixel)) continue;
    const Eigen::Vector3d ray_map = point.position - T_map_camera.translation();
    const double distance_m = ray_map.norm();
    if (ray_map.dot(point.view_direction.cast<double>()) < kMinViewCosine * distance_m) continue;
    const int octave =
        PredictOctave(ReferenceFor(focal_px, point.reference_distance_m), static_cast<float>(distance_m));
    visible.push_back({.point_idx = static_cast<int>(i),
                       .projected = {.u_px = static_cast<float>(pixel.x()),
                                     .v_px = static_cast<float>(pixel.y()),
                                     .radius_px = static_cast<float>(radius_px) * OctaveScale(octave),
                                     .octave = octave,
                                     .descriptor = point.descriptor}});
  }
  return visible;
}

struct GuidedMatch {
  int feature_idx = 0;
  int point_idx = 0;
};

std::vector<GuidedMatch> MatchGuided(const QueryKeyframe& query, std::span<const PointRecord> points,
                                     const Pose3& T_map_camera, double radius_px) {
  const std::vector<Candidate> visible = ProjectVisible(query, points, T_map_camera, radius_px);
  std::vector<ProjectedPoint> projected;
  projected.reserve(visible.size());
  for (const Candidate& candidate : visible) projected.push_back(candidate.projected);
  std::vector<GuidedMatch> matches;
  for (const Match& match : MatchProjected(projected, query.grid(), query.features(), kGuidedMatching)) {
    matches.push_back({.feature_idx = match.train_idx, .point_idx = visible[match.query_idx].point_idx});
  }
  return matches;
}

PoseResult FitPose(const QueryKeyframe& query, std::span<const PointRecord> points,
                   const std::vector<GuidedMatch>& matches, const Pose3& T_map_camera) {
  std::vector<PoseObservation> observations;
  observations.reserve(matches.size());
  const bool measured = query.view().depths == DepthKind::kMeasured;
  for (const GuidedMatch& match : matches) {
    observations.push_back({.p_world = points[match.point_idx].position,
                            .pixel = query.view().undistorted_px[match.feature_idx],
                            .sigma_px = OctaveScale(query.features()[match.feature_idx].keypoint.octave),
                            .depth_m = measured ? query.depth_m(match.feature_idx) : 0.0});
  }
  return OptimizePose(query.view().pinhole, observations, T_map_camera,
                      {.bf_px_m = DepthWeightBf(query.view().camera)});
}

bool DepthAgrees(const QueryKeyframe& query, int feature_idx, const Eigen::Vector3d& p_camera) {
  const double depth_m = query.depth_m(feature_idx);
  return depth_m <= 0 || std::abs(p_camera.z() - depth_m) < query.tolerance_m(depth_m);
}

/// The query at the scale that its depths have under `pose`; as it is when they have one.
std::optional<QueryKeyframe> Rescale(const QueryKeyframe& query, std::span<const PointRecord> points,
                                     const std::vector<GuidedMatch>& matches, const PoseResult& pose) {
  if (query.view().depths != DepthKind::kUnscaled) return query;
  std::vector<int> feature_idxs;
  std::vector<Eigen::Vector3d> p_map;
  for (size_t i = 0; i < matches.size(); ++i) {
    if (!pose.inliers[i]) continue;
    feature_idxs.push_back(matches[i].feature_idx);
    p_map.push_back(points[static_cast<size_t>(matches[i].point_idx)].position);
  }
  const std::optional<double> scale = ScaleFromDepths(query, feature_idxs, p_map, pose.T_world_camera);
  if (!scale) return std::nullopt;
  return query.AtScale(*scale);
}

ProjectionAlignment Summarize(const QueryKeyframe& query, std::span<const PointRecord> points,
                              const std::vector<GuidedMatch>& matches, const PoseResult& pose) {
  ProjectionAlignment alignment;
  alignment.T_map_camera = pose.T_world_camera;
  alignment.scale = query.scale();
  alignment.information = pose.information;
  alignment.num_offered = static_cast<int>(matches.size());
  const Pose3 T_camera_map = pose.T_world_camera.Inverse();
  std::bitset<kNumAgreementCells> cells;
  for (size_t i = 0; i < matches.size(); ++i) {
    const GuidedMatch& match = matches[i];
    const PointRecord& point = points[match.point_idx];
    if (!pose.inliers[i] || !DepthAgrees(query, match.feature_idx, T_camera_map * point.position)) continue;
    alignment.inliers.push_back({.feature_idx = match.feature_idx, .point = point.id});
    cells.set(static_cast<size_t>(AgreementCell(query, match.feature_idx)));
  }
  alignment.num_cells = static_cast<int>(cells.count());
  alignment.agreement = CompareWithView(query, ExpectedPoints(query, points, pose.T_world_camera), alignment.inliers);
  return alignment;
}

/// Frames of the map that look the camera's way from nearby, best first.
StatusOr<std::vector<FrameId>> NeighbourFrames(MapReader& reader, MapId map, const OwnFrames& besides,
                                               const Pose3& T_map_camera) {
  const Eigen::Vector3d reach = Eigen::Vector3d::Constant(kNeighbourRangeM);
  const Aabb box(T_map_camera.translation() - reach, T_map_camera.translation() + reach);
  MAPP_ASSIGN_OR_RETURN(const std::vector<FrameRecord> frames, reader.FramesInBox(map, box));
  const Eigen::Vector3d axis = T_map_camera.rotation() * Eigen::Vector3d::UnitZ();
  std::vector<std::pair<double, FrameId>> ranked;
  for (const FrameRecord& frame : frames) {
    if (besides.Contains(frame)) continue;
    const double cosine = axis.dot(frame.T_frame_camera.rotation() * Eigen::Vector3d::UnitZ());
    if (cosine < kNeighbourCosine) continue;
    ranked.emplace_back(Distance(frame.T_frame_camera, T_map_camera) + kMetersPerOppositeView * (1 - cosine) / 2,
                        frame.id);
  }
  std::sort(ranked.begin(), ranked.end());
  if (ranked.size() > kMaxNeighbourFrames) ranked.resize(kMaxNeighbourFrames);
  std::vector<FrameId> ids;
  for (const auto& [rank, id] : ranked) ids.push_back(id);
  return ids;
}

}  // namespace

QueryKeyframe::QueryKeyframe(const FrameView& view) : view_(&view) {
  std::vector<FeatureGrid::Point> pixels;
  features_.reserve(view.keyframe.features.size());
  pixels.reserve(view.keyframe.features.size());
  for (size_t i = 0; i < view.keyframe.features.size(); ++i) {
    const KeyframeFeature& feature = view.keyframe.features[i];
    features_.push_back({.keypoint = feature.keypoint, .descriptor = feature.descriptor});
    pixels.push_back({.u_px = static_cast<float>(view.undistorted_px[i].x()),
                      .v_px = static_cast<float>(view.undistorted_px[i].y())});
  }
  grid_ = FeatureGrid(pixels, view.camera.width_px, view.camera.height_px);
}

double QueryKeyframe::depth_m(int feature_idx) const {
  const std::optional<PointReference>& point = view_->keyframe.features[feature_idx].point;
  return point ? scale_ * point->depth_m : 0.0;
}

double QueryKeyframe::tolerance_m(double depth_m) const {
  const double measured_m = PointTolerance(depth_m);
  return view_->depths == DepthKind::kMeasured ? measured_m : std::max(measured_m, kTriangulatedShare * depth_m);
}

QueryKeyframe QueryKeyframe::AtScale(double scale) const {
  QueryKeyframe scaled = *this;
  scaled.scale_ = scale;
  return scaled;
}

std::optional<Eigen::Vector3d> QueryKeyframe::PointInCamera(int feature_idx) const {
  const double depth = depth_m(feature_idx);
  if (depth <= 0) return std::nullopt;
  return depth * view_->pinhole.Unproject(view_->undistorted_px[feature_idx]);
}

std::vector<ExpectedPoint> ExpectedPoints(const QueryKeyframe& query, std::span<const PointRecord> points,
                                          const Pose3& T_map_camera) {
  const Pose3 T_camera_map = T_map_camera.Inverse();
  std::vector<ExpectedPoint> expected;
  for (const Candidate& candidate : ProjectVisible(query, points, T_map_camera, kFinalRadiusPx)) {
    const PointRecord& point = points[static_cast<size_t>(candidate.point_idx)];
    const Eigen::Vector3d ray_map = point.position - T_map_camera.translation();
    if (ray_map.dot(point.view_direction.cast<double>()) < kAlikeCosine * ray_map.norm()) continue;
    const Eigen::Vector3d p_camera = T_camera_map * point.position;
    expected.push_back({{candidate.projected.u_px, candidate.projected.v_px}, static_cast<float>(p_camera.z())});
  }
  return expected;
}

double PointTolerance(double depth_m) { return std::max(0.08, 0.04 * depth_m); }

std::optional<ProjectionAlignment> AlignByProjection(const QueryKeyframe& query, std::span<const PointRecord> points,
                                                     const Pose3& T_map_camera) {
  const std::vector<GuidedMatch> wide = MatchGuided(query, points, T_map_camera, kFirstRadiusPx);
  if (wide.size() < kMinMatches) return std::nullopt;
  const PoseResult rough = FitPose(query, points, wide, T_map_camera);
  if (!rough.converged) return std::nullopt;
  const std::vector<GuidedMatch> narrow = MatchGuided(query, points, rough.T_world_camera, kFinalRadiusPx);
  if (narrow.size() < kMinMatches) return std::nullopt;
  const PoseResult refined = FitPose(query, points, narrow, rough.T_world_camera);
  if (!refined.converged) return std::nullopt;
  const std::optional<QueryKeyframe> scaled = Rescale(query, points, narrow, refined);
  if (!scaled) return std::nullopt;
  return Summarize(*scaled, points, narrow, refined);
}

std::optional<double> ScaleFromDepths(const QueryKeyframe& query, std::span<const int> feature_idxs,
                                      std::span<const Eigen::Vector3d> p_map, const Pose3& T_map_camera) {
  const Pose3 T_camera_map = T_map_camera.Inverse();
  std::vector<double> scales;
  for (size_t i = 0; i < feature_idxs.size(); ++i) {
    const double depth = query.depth_m(feature_idxs[i]) / query.scale();
    const double depth_map_m = (T_camera_map * p_map[i]).z();
    if (depth > 0 && depth_map_m > kMinDepthM) scales.push_back(depth_map_m / depth);
  }
  if (scales.size() < kMinScales) return std::nullopt;
  const double median = Median(scales);
  const auto num_near = std::ranges::count_if(
      scales, [&](double scale) { return std::abs(scale - median) < kTriangulatedShare * median; });
  if (static_cast<double>(num_near) < kMinNearMedian * static_cast<double>(scales.size())) return std::nullopt;
  return median;
}

StatusOr<std::vector<PointRecord>> PointsSeenNear(MapReader& reader, MapId map, const OwnFrames& besides,
                                                  const Pose3& T_map_camera) {
  MAPP_ASSIGN_OR_RETURN(const std::vector<FrameId> frames, NeighbourFrames(reader, map, besides, T_map_camera));
  std::unordered_set<MapPointId> seen;
  std::vector<MapPointId> ids;
  for (const FrameId frame : frames) {
    MAPP_ASSIGN_OR_RETURN(const std::vector<Observation> observations, reader.GetObservations(frame));
    for (const Observation& observation : observations) {
      if (seen.insert(observation.point).second) ids.push_back(observation.point);
    }
  }
  return reader.FindPoints(ids);
}

}  // namespace mapp
