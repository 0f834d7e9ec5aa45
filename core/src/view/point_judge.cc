#include "mapp/view/point_judge.h"

#include "mapp/base/parallel.h"
#include "mapp/feature/feature.h"
#include "mapp/geometry/neighbor_grid.h"
#include "mapp/view/view_cone.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <limits>
#include <tuple>
#include <utility>

namespace mapp {
namespace {

/// Cells for nearest neighbours among many, of the greatest distance: mostly they are in a cell or next to it.
constexpr float kCellShare = 0.25F;
constexpr size_t kFewAround = 256;

/// Rings around a camera in which distances differ by a factor of 1.41.
int8_t RingOf(float distance_m) { return static_cast<int8_t>(std::floor(2 * std::log2(distance_m))); }

void CountOne(uint16_t& counter) {
  if (counter < std::numeric_limits<uint16_t>::max()) ++counter;
}

/// The planes through the camera's centre and the sides of its image.
class ImageSides {
 public:
  ImageSides(const Camera& camera, const PinholeCamera& pinhole) {
    const auto left = static_cast<float>((-0.5 - pinhole.cx) / pinhole.fx);
    const auto top = static_cast<float>((-0.5 - pinhole.cy) / pinhole.fy);
    const auto right = static_cast<float>((camera.width_px - 0.5 - pinhole.cx) / pinhole.fx);
    const auto bottom = static_cast<float>((camera.height_px - 0.5 - pinhole.cy) / pinhole.fy);
    inward_ = {Eigen::Vector3f(1, 0, -left).normalized(), Eigen::Vector3f(-1, 0, right).normalized(),
               Eigen::Vector3f(0, 1, -top).normalized(), Eigen::Vector3f(0, -1, bottom).normalized()};
  }
  /// Whether any of a ball may be in the image. False positives at its corners.
  bool MayHold(const Eigen::Vector3f& center_camera, float radius_m) const {
    return std::ranges::all_of(inward_,
                               [&](const Eigen::Vector3f& inward) { return inward.dot(center_camera) >= -radius_m; });
  }

 private:
  std::array<Eigen::Vector3f, 4> inward_;  ///< unit normals, camera frame
};

struct Neighbor {
  float squared_m2 = 0;
  MapPointId id;
  bool is_missed = false;
};

/// The nearest of many, ties by id.
class NearestFew {
 public:
  explicit NearestFew(size_t max_num) : max_num_(max_num) {}
  void Offer(const Neighbor& one) {
    const auto is_nearer = [](const Neighbor& a, const Neighbor& b) {
      return a.squared_m2 != b.squared_m2 ? a.squared_m2 < b.squared_m2 : a.id < b.id;
    };
    if (found_.size() == max_num_) {
      if (found_.empty() || !is_nearer(one, found_.back())) return;
      found_.pop_back();
    }
    found_.insert(std::upper_bound(found_.begin(), found_.end(), one, is_nearer), one);
  }
  /// Whether nothing further away than that is among the nearest.
  bool AllWithin(float distance_m) const {
    return found_.size() == max_num_ && (found_.empty() || found_.back().squared_m2 <= distance_m * distance_m);
  }
  const std::vector<Neighbor>& found() const { return found_; }

 private:
  size_t max_num_;
  std::vector<Neighbor> found_;
};

uint16_t Sum(uint16_t a, uint16_t b) {
  return static_cast<uint16_t>(std::min<uint32_t>(uint32_t{a} + b, std::numeric_limits<uint16_t>::max()));
}

}  // namespace

bool IsSeenAsBefore(std::span<const Eigen::Vector3f> directions, float reference_distance_m, const Eigen::Vector3f& ray,
                    double focal_px, int num_levels) {
  const float distance_m = ray.norm();
  const float farthest_m = ReferenceFor(focal_px, reference_distance_m);
  const auto nearest_m = static_cast<float>(farthest_m / OctaveScale(num_levels - 1));
  if (distance_m < nearest_m || distance_m > farthest_m * static_cast<float>(kPyramidScale)) return false;
  return std::ranges::any_of(
      directions, [&](const Eigen::Vector3f& direction) { return direction.dot(ray) >= kLikeViewCosine * distance_m; });
}

double GreatestSecant(const Camera& camera) {
  double greatest = 1;
  for (const double u_px : {0.0, camera.width_px - 1.0}) {
    for (const double v_px : {0.0, camera.height_px - 1.0}) {
      greatest = std::max(greatest, camera.Unproject({u_px, v_px}).norm());
    }
  }
  return greatest;
}

MeasuredView::MeasuredView(const Keyframe& keyframe, const Pose3& with_T_map_camera, const Camera& with_camera,
                           double with_range_m, double scale)
    : T_map_camera(with_T_map_camera),
      camera(with_camera),
      range_m(with_range_m),
      complete(!keyframe.partial || keyframe.raster.has_value()),
      geometry(OwnSurfacePoints(keyframe, with_camera, scale)) {
  // A point beyond everything that was measured has nothing behind it that would show it missing.
  const double reach_m = std::min(range_m, geometry.farthest_depth_m() * GreatestSecant(camera));
  box_map = ViewCone{T_map_camera, reach_m, camera.FieldOfView()}.BoundingBox();
}

bool PointJudge::Counts::CountsFrom(int8_t view_ring) {
  if (view_ring > ring) return false;
  if (view_ring < ring) num_seen = num_missed = 0;
  ring = std::min(ring, view_ring);
  return true;
}

void PointJudge::Counts::Merge(const Counts& other) {
  if (!CountsFrom(other.ring)) return;
  num_seen = Sum(num_seen, other.num_seen);
  num_missed = Sum(num_missed, other.num_missed);
}

void PointJudge::Add(const MeasuredView& view, std::span<const SightedPoints> tiles) {
  const Pose3 T_camera_map = view.T_map_camera.Inverse();
  const Eigen::Matrix3f R_camera_map = T_camera_map.RotationMatrix().cast<float>();
  const Eigen::Vector3f t_camera_map = T_camera_map.translation().cast<float>();
  const Eigen::Vector3f center_map = view.T_map_camera.translation().cast<float>();
  const PinholeCamera pinhole = view.camera.Undistorted();
  const double focal_px = view.camera.MeanFocalPx();
  const float max_depth_m = std::min(static_cast<float>(view.range_m), view.geometry.farthest_depth_m());
  const ImageSides sides(view.camera, pinhole);
  for (const SightedPoints& tile : tiles) {
    const std::span<const SightedPoint> points = tile->points();
    std::vector<Counts>& counts = counts_[tile];
    counts.resize(points.size());
    for (const SightedTile::Block& block : tile->blocks()) {
      const Eigen::Vector3f block_camera = R_camera_map * block.center_map + t_camera_map;
      if (block_camera.z() + block.radius_m <= 0 || block_camera.z() - block.radius_m > max_depth_m) continue;
      if (!sides.MayHold(block_camera, block.radius_m)) continue;
      for (size_t i = block.begin; i < block.end; ++i) {
        const SightedPoint& point = points[i];
        if (point.founder > last_founder_) continue;
        const Eigen::Vector3f p_camera = R_camera_map * point.p_map + t_camera_map;
        if (p_camera.z() <= 0 || p_camera.z() > max_depth_m) continue;
        // By the undistorted model: a distorted one folds far rays back into the image.
        if (!view.camera.Contains(pinhole.Project(p_camera.cast<double>()), options_.image_margin_px)) continue;
        if (!IsSeenAsBefore({point.directions.data(), point.num_directions}, point.reference_distance_m,
                            point.p_map - center_map, focal_px, options_.num_levels)) {
          continue;
        }
        Count(view.geometry.At(p_camera), RingOf(p_camera.z()), view.complete, counts[i]);
      }
    }
  }
}

void PointJudge::Count(SurfaceSighting sighting, int8_t ring, bool is_complete, Counts& counts) {
  if (sighting == SurfaceSighting::kUnknown || !counts.CountsFrom(ring)) return;
  if (sighting == SurfaceSighting::kSeen) {
    CountOne(counts.num_seen);
  } else if (is_complete) {
    CountOne(counts.num_missed);
  }
}

void PointJudge::Merge(PointJudge&& other) {
  for (auto& [tile, others] : other.counts_) {
    const auto [entry, is_new] = counts_.try_emplace(tile);
    if (is_new) {
      entry->second = std::move(others);
      continue;
    }
    for (size_t i = 0; i < others.size(); ++i) entry->second[i].Merge(others[i]);
  }
}

std::vector<PointFinding> PointJudge::Conclude(int num_threads) const {
  struct Judged {
    MapPointId id;
    Eigen::Vector3f p_map;
    Counts counts;
  };
  std::vector<Judged> judged;
  for (const auto& [tile, counts] : counts_) {
    for (size_t i = 0; i < counts.size(); ++i) {
      if (counts[i].judged()) judged.push_back({tile->points()[i].id, tile->points()[i].p_map, counts[i]});
    }
  }
  std::vector<size_t> missed;
  std::vector<Eigen::Vector3f> positions;
  for (size_t i = 0; i < judged.size(); ++i) {
    positions.push_back(judged[i].p_map);
    if (judged[i].counts.missed()) missed.push_back(i);
  }
  std::vector<char> is_dropped(judged.size(), 0);
  const NeighborGrid grid(positions, options_.neighbor_radius_m);
  const NeighborGrid fine_grid(positions, kCellShare * options_.neighbor_radius_m);
  const auto is_alone = [&](size_t i) {
    NearestFew near(options_.num_neighbors);
    const auto offer = [&](size_t j, float squared_m2) {
      if (j != i && judged[j].counts.ring <= judged[i].counts.ring + 1)
        near.Offer({squared_m2, judged[j].id, judged[j].counts.missed()});
    };
    // Among few, to look at all is quicker than at the many cells between them.
    if (grid.NumAround(positions[i]) < kFewAround) {
      grid.VisitWithin(positions[i], offer);
    } else {
      fine_grid.VisitOutwards(positions[i], options_.neighbor_radius_m, offer,
                              [&](float distance_m) { return near.AllWithin(distance_m); });
    }
    const auto num = static_cast<double>(near.found().size());
    const auto num_missed = static_cast<double>(std::ranges::count_if(near.found(), &Neighbor::is_missed));
    return num == 0 || num_missed < options_.min_missed_neighbor_ratio * num;
  };
  constexpr size_t kAtATime = 1024;
  ParallelFor(num_threads, static_cast<int>((missed.size() + kAtATime - 1) / kAtATime), [&](int chunk) {
    const size_t end = std::min(missed.size(), (static_cast<size_t>(chunk) + 1) * kAtATime);
    for (size_t k = static_cast<size_t>(chunk) * kAtATime; k < end; ++k) is_dropped[missed[k]] = is_alone(missed[k]);
  });
  std::vector<PointFinding> findings;
  for (size_t i = 0; i < judged.size(); ++i) {
    if (is_dropped[i] == 0) findings.push_back({judged[i].id, judged[i].counts.num_seen, judged[i].counts.num_missed});
  }
  // The order of tiles in memory is chance.
  std::ranges::sort(findings, {},
                    [](const PointFinding& one) { return std::tie(one.point, one.num_seen, one.num_missed); });
  return findings;
}

std::vector<PointFinding> MergeFindings(std::span<const PointFinding> findings) {
  std::vector<PointFinding> merged;
  for (const PointFinding& finding : findings) {
    if (merged.empty() || merged.back().point != finding.point) {
      merged.push_back(finding);
      continue;
    }
    merged.back().num_seen = Sum(merged.back().num_seen, finding.num_seen);
    merged.back().num_missed = Sum(merged.back().num_missed, finding.num_missed);
  }
  return merged;
}

}  // namespace mapp
