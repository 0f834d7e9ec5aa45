#include "server/service/point_stats.h"

#include <algorithm>
#include <cmath>
#include <limits>
#include <vector>

namespace mapp {
namespace {

/// As TilePoint::reference_distance_m.
float ReferenceDistance(const PointRecord& point, const Sighting& sighting) {
  const double distance_m = (point.position - sighting.camera_center).norm();
  return static_cast<float>(distance_m * kReferenceFocalPx / sighting.focal_px) * OctaveScale(sighting.octave);
}

Eigen::Vector3d Direction(const Eigen::Vector3d& from, const Eigen::Vector3d& to) { return (to - from).normalized(); }

/// Index of the observer to leave out so that the others differ most in direction: of the two that are nearest to each
/// other the later one, so that a newcomer that adds nothing is the one to go.
size_t MostRedundant(std::span<const Eigen::Vector3d> directions) {
  size_t redundant = directions.size() - 1;
  double greatest_cosine = -std::numeric_limits<double>::infinity();
  for (size_t i = 0; i < directions.size(); ++i) {
    for (size_t j = i + 1; j < directions.size(); ++j) {
      const double cosine = directions[i].dot(directions[j]);
      if (cosine > greatest_cosine) {
        greatest_cosine = cosine;
        redundant = j;
      }
    }
  }
  return redundant;
}

void AddObserver(PointRecord& point, const Sighting& sighting, std::span<const Eigen::Vector3d> observer_centers) {
  if (std::ranges::count(point.observers, sighting.frame) > 0) return;
  point.observers.push_back(sighting.frame);
  if (point.observers.size() <= TilePoint::kMaxObservers) return;

  std::vector<Eigen::Vector3d> directions;
  for (const Eigen::Vector3d& center : observer_centers) directions.push_back(Direction(center, point.position));
  directions.push_back(Direction(sighting.camera_center, point.position));
  point.observers.erase(point.observers.begin() + static_cast<std::ptrdiff_t>(MostRedundant(directions)));
}

}  // namespace

Eigen::Vector3d RebuildPoint(const Camera& camera, const Pose3& T_frame_camera, const Keypoint& keypoint,
                             double depth_m) {
  return T_frame_camera * (depth_m * camera.Unproject({keypoint.u_px, keypoint.v_px}));
}

void InitPointStats(PointRecord& point, const Sighting& sighting, const OrbDescriptor& descriptor,
                    uint32_t num_observations) {
  point.view_direction = Direction(sighting.camera_center, point.position).cast<float>();
  point.descriptor = descriptor;
  point.reference_distance_m = ReferenceDistance(point, sighting);
  point.num_observations = num_observations;
  point.observers = {sighting.frame};
}

void AddObservation(PointRecord& point, const Sighting& sighting, std::span<const Eigen::Vector3d> observer_centers) {
  const float weight = 1.0F / static_cast<float>(point.num_observations + 1);
  const Eigen::Vector3f direction = Direction(sighting.camera_center, point.position).cast<float>();
  const Eigen::Vector3f mean = (1 - weight) * point.view_direction + weight * direction;
  // Two opposite views cancel out; the mean then says nothing and the old one stays.
  if (mean.norm() > 1e-3F) point.view_direction = mean.normalized();
  const float reference_m = ReferenceDistance(point, sighting);
  point.reference_distance_m += weight * (reference_m - point.reference_distance_m);
  ++point.num_observations;
  AddObserver(point, sighting, observer_centers);
}

void RemoveObservation(PointRecord& point, const Sighting& sighting) {
  std::erase(point.observers, sighting.frame);
  if (point.num_observations < 2) return;
  const float weight = 1.0F / static_cast<float>(point.num_observations);
  point.reference_distance_m =
      (point.reference_distance_m - weight * ReferenceDistance(point, sighting)) / (1 - weight);
  // The mean m was (1 - w) d + w v, scaled to length 1 by some s: the older d follows from |s m - w v| = 1 - w.
  const Eigen::Vector3f direction = Direction(sighting.camera_center, point.position).cast<float>();
  const float along = weight * point.view_direction.dot(direction);
  const float root = along * along - weight * weight + (1 - weight) * (1 - weight);
  if (root >= 0) {
    const Eigen::Vector3f older = (along + std::sqrt(root)) * point.view_direction - weight * direction;
    if (older.norm() > 1e-3F) point.view_direction = older.normalized();
  }
  --point.num_observations;
}

}  // namespace mapp
