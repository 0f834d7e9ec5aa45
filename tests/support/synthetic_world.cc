#include "tests/support/synthetic_world.h"

#include <algorithm>
#include <cmath>
#include <numbers>
#include <optional>

namespace mapp::testing {
namespace {

const Eigen::Vector3d kRoomMin(-4, -1.5, -4);
const Eigen::Vector3d kRoomMax(4, 1.5, 4);
const Eigen::AlignedBox3d kCabinet(Eigen::Vector3d(-0.7, -0.3, 2.5), Eigen::Vector3d(0.7, 1.5, 3.1));
/// Chosen so that no view shows more than kMaxFeatures landmarks.
constexpr double kLandmarksPerSquareMetre = 14;
constexpr double kCabinetLandmarksPerSquareMetre = 60;

OrbDescriptor RandomDescriptor(Rng& rng) {
  OrbDescriptor descriptor;
  for (uint64_t& word : descriptor.words) word = rng.Next();
  return descriptor;
}

OrbDescriptor WithNoise(OrbDescriptor descriptor, double bit_flip, Rng& rng) {
  for (uint64_t& word : descriptor.words) {
    for (int bit = 0; bit < 64; ++bit) {
      if (rng.Uniform() < bit_flip) word ^= uint64_t{1} << bit;
    }
  }
  return descriptor;
}

/// Whether the segment passes through the box's inside (slab test, Kay and Kajiya 1986).
bool Crosses(const Eigen::AlignedBox3d& box, const Eigen::Vector3d& from, const Eigen::Vector3d& to) {
  double enter = 0;
  double leave = 1;
  for (int i = 0; i < 3; ++i) {
    const double step = to[i] - from[i];
    if (std::abs(step) < 1e-12) {
      if (from[i] <= box.min()[i] || from[i] >= box.max()[i]) return false;
      continue;
    }
    const double a = (box.min()[i] - from[i]) / step;
    const double b = (box.max()[i] - from[i]) / step;
    enter = std::max(enter, std::min(a, b));
    leave = std::min(leave, std::max(a, b));
  }
  constexpr double kSurface = 1e-6;  // the end of the segment may lie on the box
  return leave - enter > kSurface;
}

}  // namespace

SyntheticWorld::SyntheticWorld(uint64_t seed) {
  Rng rng(seed);
  const auto cover_box = [&](const Eigen::Vector3d& low, const Eigen::Vector3d& high, double outwards, bool cabinet) {
    const Eigen::Vector3d size = high - low;
    for (int axis = 0; axis < 3; ++axis) {
      const Eigen::Vector3d a = Eigen::Vector3d::Unit((axis + 1) % 3) * size[(axis + 1) % 3];
      const Eigen::Vector3d b = Eigen::Vector3d::Unit((axis + 2) % 3) * size[(axis + 2) % 3];
      const Eigen::Vector3d normal = Eigen::Vector3d::Unit(axis) * outwards;
      CoverFace(low, a, b, -normal, cabinet, rng);
      CoverFace(low + Eigen::Vector3d::Unit(axis) * size[axis], a, b, normal, cabinet, rng);
    }
  };
  cover_box(kRoomMin, kRoomMax, -1, false);
  cover_box(kCabinet.min(), kCabinet.max(), 1, true);
}

void SyntheticWorld::CoverFace(const Eigen::Vector3d& corner, const Eigen::Vector3d& edge_a,
                               const Eigen::Vector3d& edge_b, const Eigen::Vector3d& normal, bool on_cabinet,
                               Rng& rng) {
  const double area = edge_a.norm() * edge_b.norm();
  const auto count = static_cast<int>(area * (on_cabinet ? kCabinetLandmarksPerSquareMetre : kLandmarksPerSquareMetre));
  for (int i = 0; i < count; ++i) {
    Landmark landmark;
    landmark.p_world = corner + rng.Uniform() * edge_a + rng.Uniform() * edge_b;
    landmark.normal = normal;
    landmark.reference_distance_m = 4.0 * std::pow(1.2, rng.Uniform(0, 3));
    landmark.angle = static_cast<float>(rng.Uniform(0, 2 * std::numbers::pi));
    landmark.descriptor = RandomDescriptor(rng);
    landmark.on_cabinet = on_cabinet;
    landmarks_.push_back(landmark);
  }
}

SyntheticWorld SyntheticWorld::WithoutCabinet() const {
  SyntheticWorld emptied = *this;
  emptied.has_cabinet_ = false;
  return emptied;
}

SyntheticWorld SyntheticWorld::Rearranged(double share, uint64_t seed) const {
  SyntheticWorld rearranged = *this;
  Rng rng(seed);
  for (Landmark& landmark : rearranged.landmarks_) {
    if (landmark.on_cabinet || rng.Uniform() >= share) continue;
    for (int axis = 0; axis < 3; ++axis) {
      if (landmark.normal[axis] == 0) landmark.p_world[axis] = rng.Uniform(kRoomMin[axis], kRoomMax[axis]);
    }
  }
  return rearranged;
}

Camera SyntheticWorld::DeviceCamera() {
  Camera camera;
  camera.projection = PinholeCamera{525, 525, 319.5, 239.5};
  camera.width_px = 640;
  camera.height_px = 480;
  return camera;
}

Pose3 SyntheticWorld::Stand(double x, double z, double heading) {
  return {Eigen::Quaterniond(Eigen::AngleAxisd(heading, Eigen::Vector3d::UnitY())), Eigen::Vector3d(x, 0, z)};
}

bool SyntheticWorld::IsVisible(const Landmark& landmark, const Eigen::Vector3d& center) const {
  if (landmark.on_cabinet && !has_cabinet_) return false;
  const Eigen::Vector3d to_camera = center - landmark.p_world;
  constexpr double kMinCosine = 0.2;  // flat views are not detected
  if (to_camera.dot(landmark.normal) < kMinCosine * to_camera.norm()) return false;
  return !has_cabinet_ || !Crosses(kCabinet, center, landmark.p_world);
}

Keyframe SyntheticWorld::View(const Pose3& T_world_camera, SessionId session, uint32_t number, Rng& rng,
                              uint64_t first_session_point, const SensorNoise& noise) const {
  const Camera camera = DeviceCamera();
  const Pose3 T_camera_world = T_world_camera.Inverse();
  Keyframe keyframe;
  keyframe.session = session;
  keyframe.number = number;
  keyframe.stamp_ns = int64_t{number} * 100'000'000;
  keyframe.T_frame_camera = T_world_camera;
  for (size_t i = 0; i < landmarks_.size() && keyframe.features.size() < kMaxFeatures; ++i) {
    const Landmark& landmark = landmarks_[i];
    const Eigen::Vector3d p_camera = T_camera_world * landmark.p_world;
    if (p_camera.z() < 0.3 || !IsVisible(landmark, T_world_camera.translation())) continue;
    const Eigen::Vector2d pixel =
        camera.Project(p_camera) + noise.pixel_px * Eigen::Vector2d(rng.Normal(), rng.Normal());
    if (!camera.Contains(pixel, 8)) continue;
    KeyframeFeature feature;
    feature.keypoint.u_px = static_cast<float>(pixel.x());
    feature.keypoint.v_px = static_cast<float>(pixel.y());
    feature.keypoint.angle = landmark.angle;
    const double octave = std::log(landmark.reference_distance_m / p_camera.norm()) / std::log(1.2);
    feature.keypoint.octave = static_cast<uint8_t>(std::clamp(std::lround(octave), 0L, kPyramidLevels - 1L));
    feature.descriptor = WithNoise(landmark.descriptor, noise.bit_flip, rng);
    const double depth_m = p_camera.z() * (1 + noise.depth_ratio * rng.Normal());
    feature.point =
        PointReference{PointReference::Kind::kSessionPoint, first_session_point + i, static_cast<float>(depth_m), 2};
    keyframe.features.push_back(feature);
  }
  return keyframe;
}

std::vector<Eigen::Vector3d> OwnPoints(const Keyframe& keyframe, const Camera& camera) {
  std::vector<Eigen::Vector3d> points;
  for (const KeyframeFeature& feature : keyframe.features) {
    if (!feature.point) continue;
    points.push_back(feature.point->depth_m * camera.Unproject({feature.keypoint.u_px, feature.keypoint.v_px}));
  }
  return points;
}

}  // namespace mapp::testing
