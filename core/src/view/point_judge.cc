#include "mapp/view/point_judge.h"

#include "mapp/feature/feature.h"
#include "mapp/geometry/neighbor_grid.h"
#include "mapp/view/view_cone.h"

#include <algorithm>
#include <cmath>
#include <limits>
#include <numbers>
#include <utility>

namespace mapp {
namespace {

/// Rings around a camera in which distances differ by a factor of 1.41.
int8_t RingOf(float distance_m) { return static_cast<int8_t>(std::floor(2 * std::log2(distance_m))); }

void Count(uint16_t& counter) {
  if (counter < std::numeric_limits<uint16_t>::max()) ++counter;
}

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

void PointJudge::Add(const MeasuredView& view, std::span<const SightedPoints> tiles) {
  const Pose3 T_camera_map = view.T_map_camera.Inverse();
  const Eigen::Matrix3f R_camera_map = T_camera_map.RotationMatrix().cast<float>();
  const Eigen::Vector3f t_camera_map = T_camera_map.translation().cast<float>();
  const Eigen::Vector3f center_map = view.T_map_camera.translation().cast<float>();
  const PinholeCamera pinhole = view.camera.Undistorted();
  const double focal_px = view.camera.MeanFocalPx();
  const float max_depth_m = std::min(static_cast<float>(view.range_m), view.geometry.farthest_depth_m());
  for (const SightedPoints& tile : tiles) {
    std::vector<Counts>& counts = counts_[tile];
    counts.resize(tile->size());
    for (size_t i = 0; i < tile->size(); ++i) {
      const SightedPoint& point = (*tile)[i];
      const Eigen::Vector3f p_camera = R_camera_map * point.p_map + t_camera_map;
      if (p_camera.z() <= 0 || p_camera.z() > max_depth_m) continue;
      // By the undistorted model: a distorted one folds far rays back into the image.
      if (!view.camera.Contains(pinhole.Project(p_camera.cast<double>()), options_.image_margin_px)) continue;
      if (!is_asked_(point)) continue;
      if (!IsSeenAsBefore({point.directions.data(), point.num_directions}, point.reference_distance_m,
                          point.p_map - center_map, focal_px, options_.num_levels)) {
        continue;
      }
      const SurfaceSighting sighting = view.geometry.At(p_camera);
      if (sighting == SurfaceSighting::kUnknown || !counts[i].CountsFrom(RingOf(p_camera.z()))) continue;
      switch (sighting) {
        case SurfaceSighting::kSeen:
          Count(counts[i].num_seen);
          break;
        case SurfaceSighting::kMissed:
        case SurfaceSighting::kEmpty:
          if (view.complete) Count(counts[i].num_missed);
          break;
        case SurfaceSighting::kUnknown:
          break;
      }
    }
  }
}

std::vector<PointFinding> PointJudge::Conclude() const {
  struct Judged {
    MapPointId id;
    Counts counts;
  };
  std::vector<Judged> judged;
  std::vector<Eigen::Vector3f> positions;
  size_t num_missed = 0;
  for (const auto& [tile, counts] : counts_) {
    for (size_t i = 0; i < counts.size(); ++i) {
      if (!counts[i].judged()) continue;
      judged.push_back({(*tile)[i].id, counts[i]});
      positions.push_back((*tile)[i].p_map);
      num_missed += counts[i].missed() ? 1 : 0;
    }
  }
  std::vector<bool> dropped(judged.size(), false);
  if (num_missed > 0) {
    const NeighborGrid grid(positions, options_.neighbor_radius_m);
    std::vector<std::pair<float, size_t>> near;
    for (size_t i = 0; i < judged.size(); ++i) {
      if (!judged[i].counts.missed()) continue;
      near.clear();
      grid.VisitWithin(positions[i], [&](size_t j, float squared_m2) {
        if (j != i && judged[j].counts.ring <= judged[i].counts.ring + 1) near.emplace_back(squared_m2, j);
      });
      // Ties by id: the order of tiles in memory is chance.
      const auto is_nearer = [&](const auto& a, const auto& b) {
        return a.first != b.first ? a.first < b.first : judged[a.second].id < judged[b.second].id;
      };
      const size_t num = std::min(options_.num_neighbors, near.size());
      std::partial_sort(near.begin(), near.begin() + static_cast<std::ptrdiff_t>(num), near.end(), is_nearer);
      size_t num_missed_near = 0;
      for (size_t k = 0; k < num; ++k) num_missed_near += judged[near[k].second].counts.missed() ? 1 : 0;
      dropped[i] = num == 0 ||
                   static_cast<double>(num_missed_near) < options_.min_missed_neighbor_ratio * static_cast<double>(num);
    }
  }
  std::vector<PointFinding> findings;
  for (size_t i = 0; i < judged.size(); ++i) {
    if (!dropped[i]) findings.push_back({judged[i].id, judged[i].counts.num_seen, judged[i].counts.num_missed});
  }
  std::sort(findings.begin(), findings.end(),
            [](const PointFinding& a, const PointFinding& b) { return a.point < b.point; });
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
