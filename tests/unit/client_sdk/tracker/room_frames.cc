#include "tests/unit/client_sdk/tracker/room_frames.h"

#include "mapp/base/check.h"
#include "sim/renderer.h"
#include "sim/room.h"
#include "sim/sensor_noise.h"

#include <map>
#include <utility>

namespace mapp::tracker_test {
namespace {

constexpr size_t kNumFrames = 24;

RoomFrames Draw() {
  RoomFrames room;
  const auto sequence = sim::MakeRoomSequence({});
  MAPP_CHECK(sequence.ok());
  room.camera = (*sequence)->camera();
  for (size_t i = 0; i < kNumFrames; ++i) {
    auto frame = (*sequence)->Read(i);
    MAPP_CHECK(frame.ok());
    room.frames.push_back(*std::move(frame));
    room.T_world_camera.push_back((*sequence)->ground_truth()[i].T_world_camera);
  }
  return room;
}

}  // namespace

const RoomFrames& FirstRoomFrames() {
  static const RoomFrames room = Draw();
  return room;
}

RoomStereo MakeRoomStereo(size_t num_frames) {
  const auto scene = sim::BuildRoom(1);
  MAPP_CHECK(scene.ok());
  const auto renderer = sim::MakeRasterRenderer(*scene, 2);
  RoomStereo stereo;
  stereo.camera = sim::RoomCamera();
  stereo.T_left_right = Pose3(Eigen::Quaterniond::Identity(), {0.12, 0, 0});
  const std::vector<StampedPose> trajectory = sim::RoomTrajectory(0);
  const auto draw = [&](const Pose3& T_world_camera, uint64_t seed) {
    auto image = renderer->Render(stereo.camera, T_world_camera);
    MAPP_CHECK(image.ok());
    sim::AddSensorNoise({}, seed, *image);
    return std::move(image->gray);
  };
  for (size_t i = 0; i < num_frames; ++i) {
    const Pose3& T_world_left = trajectory[i].T_world_camera;
    SequenceFrame frame;
    frame.stamp_ns = trajectory[i].stamp_ns;
    frame.gray = draw(T_world_left, 2 * i);
    frame.right_gray = draw(T_world_left * stereo.T_left_right, 2 * i + 1);
    stereo.frames.push_back(std::move(frame));
    stereo.T_world_camera.push_back(T_world_left);
  }
  return stereo;
}

TrackerFrame Borrow(const SequenceFrame& frame) {
  TrackerFrame borrowed;
  borrowed.stamp_ns = frame.stamp_ns;
  borrowed.gray = frame.gray.View();
  if (!frame.depth_m.empty()) borrowed.depth_m = frame.depth_m.View();
  if (!frame.right_gray.empty()) borrowed.right_gray = frame.right_gray.View();
  return borrowed;
}

OrbTrackerOptions SynchronousOptions() {
  OrbTrackerOptions options;
  options.synchronous = true;
  return options;
}

SharedMap MakeSharedMap(const std::vector<Keyframe>& keyframes, const Camera& camera, const Pose3& T_target_source,
                        uint32_t number, uint64_t first_id) {
  std::map<uint64_t, SharedPoint> points;
  for (const Keyframe& keyframe : keyframes) {
    for (const KeyframeFeature& feature : keyframe.features) {
      if (!feature.point) continue;
      const Eigen::Vector2d pixel(feature.keypoint.u_px, feature.keypoint.v_px);
      const Eigen::Vector3d p_camera = static_cast<double>(feature.point->depth_m) * camera.Unproject(pixel);
      const Eigen::Vector3d d_source = keyframe.T_frame_camera.rotation() * p_camera;
      SharedPoint& point = points[feature.point->id];
      point.id = MapPointId(feature.point->id + first_id);
      point.p_session = T_target_source * (keyframe.T_frame_camera * p_camera);
      point.view_direction_session = (T_target_source.rotation() * d_source).normalized().cast<float>();
      point.descriptor = feature.descriptor;
      point.reference_distance_m = static_cast<float>(d_source.norm()) * OctaveScale(feature.keypoint.octave);
      point.num_observations = feature.point->num_observations;
    }
  }
  SharedMap map;
  map.number = number;
  for (auto& [id, point] : points) map.points.push_back(point);
  return map;
}

}  // namespace mapp::tracker_test
