#include "server/service/alignment_verifier.h"

#include "vision/robust_estimators.h"

#include <algorithm>
#include <cmath>
#include <numbers>
#include <unordered_map>

namespace mapp {
namespace {

constexpr MatchOptions kGlobalMatching = {.max_distance = 64, .max_ratio = 0.85, .mutual = true};
/// Below this many agreeing pairs a rigid motion is too often chance to be worth a guided match.
constexpr RansacOptions kRigidRansac = {.max_iterations = 2000, .success_probability = 0.999, .min_inliers = 10};

/// A sample of three pixels is solved a hundred times slower than one of three points is fitted.
constexpr RansacOptions kPnpRansac = {.max_iterations = 300, .success_probability = 0.999, .min_inliers = 10};
constexpr double kMaxPnpErrorPx = 6;

constexpr double kSamePlaceM = 3.0;
const double kSamePlaceCosine = std::cos(60.0 * std::numbers::pi / 180.0);
/// Two poses of one keyframe that lie further apart than this are two places.
constexpr double kRivalDistanceM = 0.5;

/// Query features matched with the map points that one or several frames of one place observe.
struct Place {
  std::vector<Pose3> T_map_frames;
  std::vector<AlignmentMatch> matches;
};

bool StandTogether(const Pose3& a, const Pose3& b) {
  const Eigen::Vector3d axis_a = a.rotation() * Eigen::Vector3d::UnitZ();
  const Eigen::Vector3d axis_b = b.rotation() * Eigen::Vector3d::UnitZ();
  return Distance(a, b) < kSamePlaceM && axis_a.dot(axis_b) > kSamePlaceCosine;
}

/// Features of `query` with depth, matched with the features of `frame` that observe map points.
std::vector<AlignmentMatch> MatchFrames(const QueryKeyframe& query, const FrameView& frame) {
  std::vector<int> query_indices;
  std::vector<Feature> query_features;
  for (int i = 0; i < static_cast<int>(query.features().size()); ++i) {
    if (query.depth_m(i) <= 0) continue;
    query_indices.push_back(i);
    query_features.push_back(query.features()[i]);
  }
  std::vector<MapPointId> points;
  std::vector<Feature> train_features;
  for (size_t i = 0; i < frame.points.size(); ++i) {
    if (!frame.points[i]) continue;
    points.push_back(*frame.points[i]);
    train_features.push_back(
        {.keypoint = frame.keyframe.features[i].keypoint, .descriptor = frame.keyframe.features[i].descriptor});
  }
  const auto descriptors = [](const std::vector<Feature>& features) {
    std::vector<OrbDescriptor> result;
    result.reserve(features.size());
    for (const Feature& feature : features) result.push_back(feature.descriptor);
    return result;
  };
  const std::vector<Match> raw =
      MatchDescriptors(descriptors(query_features), descriptors(train_features), kGlobalMatching);
  std::vector<AlignmentMatch> matches;
  for (const Match& match : FilterByRotation(raw, query_features, train_features)) {
    matches.push_back({.feature_idx = query_indices[match.query_idx], .point = points[match.train_idx]});
  }
  return matches;
}

/// Matches the query with every candidate; candidates that stand together share a place. Best candidate's place first.
StatusOr<std::vector<Place>> MatchPlaces(MapReader& reader, const QueryKeyframe& query,
                                         std::span<const FrameId> candidates) {
  std::vector<Place> places;
  for (const FrameId candidate : candidates) {
    MAPP_ASSIGN_OR_RETURN(const FrameView frame, LoadFrame(reader, candidate));
    const std::vector<AlignmentMatch> matches = MatchFrames(query, frame);
    const Pose3& T_map_frame = frame.record.T_frame_camera;
    auto place = std::find_if(places.begin(), places.end(), [&](const Place& known) {
      return StandTogether(known.T_map_frames.front(), T_map_frame);
    });
    if (place == places.end()) place = places.insert(places.end(), Place{});
    place->T_map_frames.push_back(T_map_frame);
    place->matches.insert(place->matches.end(), matches.begin(), matches.end());
  }
  return places;
}

/// Query features and the points that they may show.
struct PointPairs {
  std::vector<int> feature_idxs;
  std::vector<Eigen::Vector3d> p_map;
};

StatusOr<PointPairs> LoadPairs(MapReader& reader, const Place& place) {
  std::vector<AlignmentMatch> matches = place.matches;
  const auto key = [](const AlignmentMatch& match) { return std::make_pair(match.feature_idx, match.point); };
  std::sort(matches.begin(), matches.end(), [&](const auto& a, const auto& b) { return key(a) < key(b); });
  matches.erase(
      std::unique(matches.begin(), matches.end(), [&](const auto& a, const auto& b) { return key(a) == key(b); }),
      matches.end());
  std::vector<MapPointId> ids;
  for (const AlignmentMatch& match : matches) ids.push_back(match.point);
  std::sort(ids.begin(), ids.end());
  ids.erase(std::unique(ids.begin(), ids.end()), ids.end());
  MAPP_ASSIGN_OR_RETURN(const std::vector<PointRecord> points, reader.FindPoints(ids));
  std::unordered_map<MapPointId, Eigen::Vector3d> positions;
  for (const PointRecord& point : points) positions.emplace(point.id, point.position);

  PointPairs pairs;
  for (const AlignmentMatch& match : matches) {
    const auto position = positions.find(match.point);
    if (position == positions.end()) continue;
    pairs.feature_idxs.push_back(match.feature_idx);
    pairs.p_map.push_back(position->second);
  }
  return pairs;
}

/// A first T_map_camera, and what a unit of the query's depths is in the map.
struct RoughAlignment {
  Pose3 T_map_camera;
  double scale = 1;
};

/// From the query's own points and the map's.
std::optional<RoughAlignment> EstimateFromPoints(const QueryKeyframe& query, const PointPairs& pairs) {
  std::vector<Eigen::Vector3d> p_camera;
  std::vector<double> tolerances_m;
  for (const int feature_idx : pairs.feature_idxs) {
    p_camera.push_back(*query.PointInCamera(feature_idx));
    tolerances_m.push_back(PointTolerance(query.depth_m(feature_idx)));
  }
  const std::optional<RigidResult> rigid =
      EstimateRigid(p_camera, pairs.p_map, tolerances_m, /*with_scale=*/false, kRigidRansac);
  if (!rigid) return std::nullopt;
  return RoughAlignment{rigid->T_target_source.pose, 1};
}

/// From the query's pixels and the map's points, its depths last: triangulated ones are too uncertain for a sample of
/// three to tell a similarity, and all of them together tell its scale well.
std::optional<RoughAlignment> EstimateFromPixels(const QueryKeyframe& query, const PointPairs& pairs) {
  std::vector<Eigen::Vector2d> pixels;
  for (const int feature_idx : pairs.feature_idxs) pixels.push_back(query.view().undistorted_px[feature_idx]);
  const std::optional<PnpResult> pose =
      EstimatePose(query.view().pinhole, pairs.p_map, pixels, kMaxPnpErrorPx, kPnpRansac);
  if (!pose) return std::nullopt;
  std::vector<int> seen_idxs;
  std::vector<Eigen::Vector3d> p_seen;
  for (size_t i = 0; i < pixels.size(); ++i) {
    if (!pose->inliers[i]) continue;
    seen_idxs.push_back(pairs.feature_idxs[i]);
    p_seen.push_back(pairs.p_map[i]);
  }
  const std::optional<double> scale = ScaleFromDepths(query, seen_idxs, p_seen, pose->T_world_camera);
  if (!scale) return std::nullopt;
  return RoughAlignment{pose->T_world_camera, *scale};
}

/// From the matches alone.
StatusOr<std::optional<RoughAlignment>> EstimateFromMatches(MapReader& reader, const QueryKeyframe& query,
                                                            const Place& place) {
  MAPP_ASSIGN_OR_RETURN(const PointPairs pairs, LoadPairs(reader, place));
  return query.view().depths == DepthKind::kUnscaled ? EstimateFromPixels(query, pairs)
                                                     : EstimateFromPoints(query, pairs);
}

bool IsSupported(const ProjectionAlignment& alignment, const RegistrarOptions& options) {
  const auto num_inliers = static_cast<double>(alignment.inliers.size());
  return num_inliers >= options.min_inliers && num_inliers >= options.min_inlier_ratio * alignment.num_offered &&
         alignment.num_cells >= options.min_inlier_cells && Tolerates(options, alignment.agreement);
}

/// The best of the tried alignments, if it is good enough and no other place rivals it.
std::optional<ProjectionAlignment> Choose(std::vector<ProjectionAlignment> tried, const RegistrarOptions& options) {
  if (tried.empty()) return std::nullopt;
  const auto by_inliers = [](const ProjectionAlignment& a, const ProjectionAlignment& b) {
    return a.inliers.size() < b.inliers.size();
  };
  const auto best = std::max_element(tried.begin(), tried.end(), by_inliers);
  if (!IsSupported(*best, options)) return std::nullopt;
  const double rival_inliers = options.max_rival_share * static_cast<double>(best->inliers.size());
  for (const ProjectionAlignment& other : tried) {
    if (Distance(other.T_map_camera, best->T_map_camera) > kRivalDistanceM &&
        static_cast<double>(other.inliers.size()) > rival_inliers) {
      return std::nullopt;
    }
  }
  return std::move(*best);
}

}  // namespace

StatusOr<VerificationResult> VerifyCandidates(MapReader& reader, const FrameView& query,
                                              std::span<const FrameId> candidates, const OwnFrames& own,
                                              const RegistrarOptions& options) {
  const QueryKeyframe keyframe(query);
  MAPP_ASSIGN_OR_RETURN(const std::vector<Place> places, MatchPlaces(reader, keyframe, candidates));
  std::vector<ProjectionAlignment> tried;
  VerificationResult result;
  for (const Place& place : places) {
    MAPP_ASSIGN_OR_RETURN(const std::optional<RoughAlignment> rough, EstimateFromMatches(reader, keyframe, place));
    if (!rough) continue;
    MAPP_ASSIGN_OR_RETURN(const std::vector<PointRecord> points,
                          PointsSeenNear(reader, query.record.map, own, rough->T_map_camera));
    std::optional<ProjectionAlignment> alignment =
        AlignByProjection(keyframe.AtScale(rough->scale), points, rough->T_map_camera);
    if (!alignment) continue;
    result.best_inliers = std::max(result.best_inliers, static_cast<int>(alignment->inliers.size()));
    tried.push_back(std::move(*alignment));
  }
  if (std::optional<ProjectionAlignment> chosen = Choose(std::move(tried), options)) {
    result.alignment = KeyframeAlignment{
        .number = query.record.number, .T_session_camera = query.record.T_frame_camera, .match = std::move(*chosen)};
  }
  return result;
}

}  // namespace mapp
