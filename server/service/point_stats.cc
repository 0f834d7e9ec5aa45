#include "server/service/point_stats.h"

#include <algorithm>
#include <limits>
#include <vector>

namespace mapp {
namespace {

/// Distance at which a feature seen at `keypoint.octave` from `distance_m` would be detected at octave 0.
float ReferenceDistance(double distance_m, const Keypoint& keypoint) {
  return static_cast<float>(distance_m) * OctaveScale(keypoint.octave);
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

void AddObserver(PointRecord& point, FrameId frame, const Eigen::Vector3d& camera_center,
                 std::span<const Eigen::Vector3d> observer_centers) {
  if (std::find(point.observers.begin(), point.observers.end(), frame) != point.observers.end()) return;
  point.observers.push_back(frame);
  if (point.observers.size() <= TilePoint::kMaxObservers) return;

  std::vector<Eigen::Vector3d> directions;
  for (const Eigen::Vector3d& center : observer_centers) directions.push_back(Direction(center, point.position));
  directions.push_back(Direction(camera_center, point.position));
  point.observers.erase(point.observers.begin() + static_cast<std::ptrdiff_t>(MostRedundant(directions)));
}

}  // namespace

Eigen::Vector3d RebuildPoint(const Camera& camera, const Pose3& T_frame_camera, const Keypoint& keypoint,
                             double depth_m) {
  return T_frame_camera * (depth_m * camera.Unproject({keypoint.u_px, keypoint.v_px}));
}

void InitPointStats(PointRecord& point, FrameId frame, const Eigen::Vector3d& camera_center, const Keypoint& keypoint,
                    const OrbDescriptor& descriptor, uint32_t num_observations) {
  point.view_direction = Direction(camera_center, point.position).cast<float>();
  point.descriptor = descriptor;
  point.reference_distance_m = ReferenceDistance((point.position - camera_center).norm(), keypoint);
  point.num_observations = num_observations;
  point.observers = {frame};
}

void AddObservation(PointRecord& point, FrameId frame, const Eigen::Vector3d& camera_center, const Keypoint& keypoint,
                    std::span<const Eigen::Vector3d> observer_centers) {
  const float weight = 1.0F / static_cast<float>(point.num_observations + 1);
  const Eigen::Vector3f direction = Direction(camera_center, point.position).cast<float>();
  const Eigen::Vector3f mean = (1 - weight) * point.view_direction + weight * direction;
  // Two opposite views cancel out; the mean then says nothing and the old one stays.
  if (mean.norm() > 1e-3F) point.view_direction = mean.normalized();
  const float reference_m = ReferenceDistance((point.position - camera_center).norm(), keypoint);
  point.reference_distance_m += weight * (reference_m - point.reference_distance_m);
  ++point.num_observations;
  AddObserver(point, frame, camera_center, observer_centers);
}

}  // namespace mapp
