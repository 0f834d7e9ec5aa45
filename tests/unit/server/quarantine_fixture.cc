#include "tests/unit/server/quarantine_fixture.h"

#include "mapp/codec/keyframe_codec.h"

#include <numbers>

namespace mapp::testing {

std::vector<Pose3> Round(int count, double first_heading) {
  std::vector<Pose3> poses;
  for (int i = 0; i < count; ++i) {
    const double heading = first_heading + 2 * std::numbers::pi * i / count;
    poses.push_back(SyntheticWorld::Stand(0.6 * std::sin(heading), 0.6 * std::cos(heading), heading));
  }
  return poses;
}

void ScrambleDescriptors(Keyframe& keyframe, Rng& rng) {
  for (KeyframeFeature& feature : keyframe.features) {
    for (uint64_t& word : feature.descriptor.words) word = rng.Next();
  }
}

Corrupt ScaleDepths(double factor) {
  return [factor](Keyframe& keyframe, Rng&) {
    for (KeyframeFeature& feature : keyframe.features) feature.point->depth_m *= static_cast<float>(factor);
  };
}

Corrupt ScaleWorld(double factor) {
  return [factor](Keyframe& keyframe, Rng& rng) {
    keyframe.T_frame_camera = Pose3(keyframe.T_frame_camera.rotation(), factor * keyframe.T_frame_camera.translation());
    ScaleDepths(factor)(keyframe, rng);
  };
}

void GarbagePose(Keyframe& keyframe, Rng& rng) {
  const Eigen::Quaterniond turn(Eigen::AngleAxisd(rng.Uniform(-3, 3), Eigen::Vector3d::UnitY()));
  keyframe.T_frame_camera = Pose3(turn, {rng.Uniform(-3, 3), rng.Uniform(-1, 1), rng.Uniform(-3, 3)});
}

void NewNumbers(Keyframe& keyframe, uint64_t first) {
  for (size_t i = 0; i < keyframe.features.size(); ++i) keyframe.features[i].point->id = first + i;
}

void LosesItsWay(Keyframe& keyframe, Rng&) {
  const Pose3 T_wrong_right(Eigen::Quaterniond(Eigen::AngleAxisd(0.7, Eigen::Vector3d::UnitY())), {0.8, 0.1, -1.1});
  keyframe.T_frame_camera = T_wrong_right * keyframe.T_frame_camera;
  NewNumbers(keyframe, 1'000'000 + 1'000 * uint64_t{keyframe.number});
}

void WrongIntrinsics(Keyframe& keyframe, Rng&) {
  for (KeyframeFeature& feature : keyframe.features) {
    feature.keypoint.u_px = 319.5F + (feature.keypoint.u_px - 319.5F) * 400 / 525;
    feature.keypoint.v_px = 239.5F + (feature.keypoint.v_px - 239.5F) * 400 / 525;
  }
  NewNumbers(keyframe, 1'000'000 + 1'000 * uint64_t{keyframe.number});
}

}  // namespace mapp::testing
