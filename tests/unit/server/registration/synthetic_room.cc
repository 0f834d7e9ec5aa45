#include "tests/unit/server/registration/synthetic_room.h"

#include "vision/matching.h"

#include <algorithm>
#include <cmath>
#include <iterator>
#include <numbers>

namespace mapp::testing {
namespace {

constexpr int kNumLandmarks = 9000;
const Eigen::Vector3d kHalfSizeM(3.0, 1.5, 2.5);
constexpr double kMinDepthM = 0.3;
/// Landmarks seen at a flatter angle are not detected.
constexpr double kMinFacingCosine = 0.3;

OrbDescriptor RandomDescriptor(Rng& rng) {
  OrbDescriptor descriptor;
  for (uint64_t& word : descriptor.words) word = rng.Next();
  return descriptor;
}

OrbDescriptor FlipBits(OrbDescriptor descriptor, double probability, Rng& rng) {
  for (uint64_t& word : descriptor.words) {
    for (int bit = 0; bit < 64; ++bit) {
      if (rng.Uniform() < probability) word ^= uint64_t{1} << bit;
    }
  }
  return descriptor;
}

}  // namespace

SyntheticRoom::SyntheticRoom(uint64_t seed) {
  Rng rng(seed);
  for (int i = 0; i < kNumLandmarks; ++i) {
    const auto wall_axis = static_cast<int>(rng.Below(3));
    const double side = rng.Uniform() < 0.5 ? -1.0 : 1.0;
    Landmark landmark;
    for (int axis = 0; axis < 3; ++axis) landmark.p_world[axis] = kHalfSizeM[axis] * rng.Uniform(-1, 1);
    landmark.p_world[wall_axis] = side * kHalfSizeM[wall_axis];
    landmark.normal = -side * Eigen::Vector3d::Unit(wall_axis);
    landmark.reference_distance_m = static_cast<float>(rng.Uniform(3, 10));
    landmark.angle = static_cast<float>(rng.Uniform(0, 2 * std::numbers::pi));
    landmark.descriptor = RandomDescriptor(rng);
    landmarks_.push_back(landmark);
  }
}

SyntheticRoom::SyntheticRoom(uint64_t seed, const SyntheticRoom& twin, double panel_from_m) : SyntheticRoom(seed) {
  const auto is_on_panel = [&](const Landmark& landmark) {
    return landmark.normal.z() < 0 && landmark.p_world.x() > panel_from_m;
  };
  std::erase_if(landmarks_, is_on_panel);
  std::ranges::copy_if(twin.landmarks_, std::back_inserter(landmarks_), is_on_panel);
}

Camera SyntheticRoom::DeviceCamera() {
  return {.projection = PinholeCamera{.fx = 525, .fy = 525, .cx = 319.5, .cy = 239.5},
          .width_px = 640,
          .height_px = 480,
          .stereo_baseline_m = 0};
}

Pose3 SyntheticRoom::Stand(double x, double z, double heading) {
  const Eigen::Quaterniond rotation(Eigen::AngleAxisd(heading, Eigen::Vector3d::UnitY()));
  return Pose3(rotation, Eigen::Vector3d(x, 0, z));
}

std::vector<Pose3> SyntheticRoom::Circle(double radius_m, double first, double step, int count) {
  std::vector<Pose3> poses;
  for (int i = 0; i < count; ++i) {
    const double heading = first + i * step;
    poses.push_back(Stand(radius_m * std::sin(heading), radius_m * std::cos(heading), heading));
  }
  return poses;
}

Keyframe SyntheticRoom::View(const Pose3& T_world_camera, const Pose3& T_world_session, SessionId session,
                             uint32_t number, const ViewNoise& noise, Rng& rng) const {
  const Camera camera = DeviceCamera();
  const Pose3 T_camera_world = T_world_camera.Inverse();
  Keyframe keyframe;
  keyframe.session = session;
  keyframe.number = number;
  keyframe.stamp_ns = int64_t{number} * 100'000'000;
  keyframe.T_frame_camera = T_world_session.Inverse() * T_world_camera;
  for (size_t i = 0; i < landmarks_.size() && keyframe.features.size() < kMaxFeatures; ++i) {
    const Landmark& landmark = landmarks_[i];
    const Eigen::Vector3d p_camera = T_camera_world * landmark.p_world;
    if (p_camera.z() < kMinDepthM) continue;
    const Eigen::Vector3d to_camera = (T_world_camera.translation() - landmark.p_world).normalized();
    if (to_camera.dot(landmark.normal) < kMinFacingCosine) continue;
    const Eigen::Vector2d pixel =
        camera.Project(p_camera) + noise.pixel_px * Eigen::Vector2d(rng.Normal(), rng.Normal());
    if (!camera.Contains(pixel, 1)) continue;
    const int octave = PredictOctave(landmark.reference_distance_m, static_cast<float>(p_camera.norm()));
    const double depth_m = p_camera.z() * (1 + noise.depth_share * rng.Normal());
    keyframe.features.push_back({.keypoint = {.u_px = static_cast<float>(pixel.x()),
                                              .v_px = static_cast<float>(pixel.y()),
                                              .angle = landmark.angle,
                                              .octave = static_cast<uint8_t>(octave)},
                                 .descriptor = FlipBits(landmark.descriptor, noise.bit_flip, rng),
                                 .point = PointReference{.kind = PointReference::Kind::kSessionPoint,
                                                         .id = i + 1,
                                                         .depth_m = static_cast<float>(depth_m),
                                                         .num_observations = 1}});
  }
  return keyframe;
}

}  // namespace mapp::testing
