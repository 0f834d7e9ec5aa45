#include "server/service/update_checker.h"

#include "mapp/view/point_judge.h"
#include "mapp/view/sampler.h"
#include "mapp/view/seen_geometry.h"
#include "server/service/point_tree.h"
#include "server/service/view_search.h"

#include <algorithm>
#include <cmath>
#include <map>
#include <optional>
#include <utility>

namespace mapp {
namespace {

/// Map points this near to the image border may have been cut off by pose error.
constexpr double kImageMarginPx = 16;

/// A map point that at least one keyframe should have seen.
struct Judged {
  Eigen::Vector3f p_map;
  bool seen = false;
};

class Comparison {
 public:
  explicit Comparison(const UpdateOptions& options) : options_(options) {}

  Status Add(TileCache& tiles, const ReportedKeyframe& reported) {
    const SeenGeometry seen(OwnSurfacePoints(reported.keyframe, reported.view.camera), options_.sighting);
    if (seen.points().empty()) return absl::OkStatus();
    ViewCone reach = reported.view.Cone();
    // A point beyond everything that was seen has no own point behind it.
    reach.range_m = seen.farthest_depth_m() * GreatestSecant(reported.view.camera);
    MAPP_ASSIGN_OR_RETURN(auto tiles_in_reach, tiles.TilesInBox(reported.view.map, reach.BoundingBox()));
    ViewSearch search(reported.view.Cone(), std::move(tiles_in_reach));
    // What a raster holds beside them is too far to be new, or known.
    CountNew(OwnFeaturePoints(reported.keyframe, reported.view.camera), search);
    JudgeMapPoints(reported.view, seen, search);
    return absl::OkStatus();
  }

  StatusOr<UpdateResult> Conclude() const {
    UpdateResult result;
    if (num_own_ > 0) result.new_share = static_cast<double>(num_new_) / static_cast<double>(num_own_);
    MAPP_ASSIGN_OR_RETURN(const std::vector<MissingPoint> missing, FindMissing());
    for (const MissingPoint& point : missing) result.missing_points.push_back(point.id);
    MAPP_ASSIGN_OR_RETURN(result.missing_boxes, BoxesAround(missing));
    const double enough_missing = options_.min_missing_ratio * static_cast<double>(judged_.size());
    if (missing.size() >= options_.min_missing_points && static_cast<double>(missing.size()) >= enough_missing) {
      result.verdict = UpdateVerdict::kUpdating;
    } else if (result.new_share >= options_.min_new_ratio) {
      result.verdict = UpdateVerdict::kExpansion;
    }
    return result;
  }

 private:
  struct MissingPoint {
    MapPointId id;
    Eigen::Vector3f p_map;
  };

  void CountNew(const std::vector<Eigen::Vector3f>& own, ViewSearch& search) {
    const std::vector<bool> held = search.AnyWithinScaled(own, options_.sighting.match_radius);
    num_new_ += static_cast<size_t>(std::count(held.begin(), held.end(), false));
    num_own_ += own.size();
  }

  void JudgeMapPoints(const MapView& view, const SeenGeometry& seen, const ViewSearch& search) {
    const Pose3 T_camera_map = view.T_map_camera.Inverse();
    const Eigen::Vector3f center = view.T_map_camera.translation().cast<float>();
    const double focal_px = view.camera.MeanFocalPx();
    for (const auto& tile : search.tiles()) {
      tile->ForEachPoint([&](const LoadedPoint& point) {
        if (point.confidence < options_.min_confidence) return;
        if (!IsSeenAsBefore({point.observer_directions.data(), point.num_observers}, point.reference_distance_m,
                            point.p_map - center, focal_px, view.num_levels)) {
          return;
        }
        const Eigen::Vector3d p_camera = T_camera_map * point.p_map.cast<double>();
        if (p_camera.z() <= 0 || p_camera.z() > view.range_m || !InImage(view.camera, p_camera)) return;
        Judge(point, seen.At(p_camera.cast<float>()));
      });
    }
  }

  void Judge(const LoadedPoint& point, SurfaceSighting sighting) {
    if (sighting == SurfaceSighting::kSeen) {
      judged_[point.id] = {point.p_map, true};
    } else if (sighting == SurfaceSighting::kMissed) {
      judged_.try_emplace(point.id, Judged{point.p_map, false});
    }
  }

  /// By the undistorted model: a distorted one folds far rays back into the image.
  static bool InImage(const Camera& camera, const Eigen::Vector3d& p_camera) {
    return camera.Contains(camera.Undistorted().Project(p_camera), kImageMarginPx);
  }

  /// The unseen points most of whose nearest judged neighbours are unseen too.
  StatusOr<std::vector<MissingPoint>> FindMissing() const {
    std::vector<MissingPoint> missing;
    std::vector<Eigen::Vector3f> positions;
    std::vector<bool> seen;
    for (const auto& [id, judged] : judged_) {
      positions.push_back(judged.p_map);
      seen.push_back(judged.seen);
    }
    if (positions.empty()) return missing;
    MAPP_ASSIGN_OR_RETURN(const PointTree tree, PointTree::Build(positions));
    for (const auto& [id, judged] : judged_) {
      if (judged.seen) continue;
      // The point itself is its own nearest.
      const std::vector<size_t> nearest = tree.Nearest(judged.p_map, options_.num_neighbors + 1);
      const auto num_unseen =
          static_cast<double>(std::count_if(nearest.begin(), nearest.end(), [&](size_t i) { return !seen[i]; }) - 1);
      const double num_neighbors = static_cast<double>(nearest.size()) - 1;
      if (num_neighbors > 0 && num_unseen >= options_.min_missing_neighbor_ratio * num_neighbors) {
        missing.push_back({id, judged.p_map});
      }
    }
    return missing;
  }

  /// Boxes around groups of points that gaps of more than box_gap_m part (single linkage).
  StatusOr<std::vector<Aabb>> BoxesAround(const std::vector<MissingPoint>& missing) const {
    std::vector<Aabb> boxes;
    if (missing.empty()) return boxes;
    std::vector<Eigen::Vector3f> positions;
    for (const MissingPoint& point : missing) positions.push_back(point.p_map);
    MAPP_ASSIGN_OR_RETURN(const PointTree tree, PointTree::Build(positions));
    std::vector<bool> reached(positions.size(), false);
    for (size_t seed = 0; seed < positions.size(); ++seed) {
      if (reached[seed]) continue;
      reached[seed] = true;
      std::vector<size_t> open = {seed};
      Aabb box;
      while (!open.empty()) {
        const size_t current = open.back();
        open.pop_back();
        box.extend(positions[current].cast<double>());
        tree.AnyWithin(positions[current], options_.box_gap_m, [&](size_t i) {
          if (!reached[i]) open.push_back(i);
          reached[i] = true;
          return false;
        });
      }
      boxes.push_back(box);
    }
    return boxes;
  }

  const UpdateOptions& options_;
  std::map<MapPointId, Judged> judged_;
  size_t num_own_ = 0;
  size_t num_new_ = 0;
};

}  // namespace

StatusOr<UpdateResult> CompareWithMap(TileCache& tiles, std::span<const ReportedKeyframe> keyframes,
                                      const UpdateOptions& options) {
  Comparison comparison(options);
  for (const ReportedKeyframe& keyframe : keyframes) MAPP_RETURN_IF_ERROR(comparison.Add(tiles, keyframe));
  return comparison.Conclude();
}

}  // namespace mapp
