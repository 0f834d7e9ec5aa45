// A SLAM system of your own behind the adapter. The "SLAM system" here walks along a wall of points whose positions it
// knows; what matters is what it hands to Participant and what it takes from it.
//
//   mapp-server --db maps.db &
//   02_foreign_slam MAP_NAME [SERVER]        (run it twice: the second device finds the wall mapped)

#include "mapp/base/rng.h"
#include "mapp/client/participant.h"

#include <chrono>
#include <cstdio>
#include <mutex>
#include <string>
#include <vector>

namespace {

using std::chrono::seconds;

constexpr int kNumSteps = 40;
constexpr double kStepM = 0.15;
/// Fewer matches than this count as a localisation failure (ORB-SLAM3's threshold).
constexpr int kMinMatches = 75;

mapp::Camera MakeCamera() {
  mapp::Camera camera;
  camera.projection = mapp::PinholeCamera{.fx = 500, .fy = 500, .cx = 319.5, .cy = 239.5};
  camera.width_px = 640;
  camera.height_px = 480;
  return camera;
}

struct Landmark {
  Eigen::Vector3d p_session;
  mapp::OrbDescriptor descriptor;
};

/// A wall about 3 m ahead, 12 m long. Every device sees the same descriptors.
std::vector<Landmark> MakeWall() {
  mapp::Rng rng(1);
  std::vector<Landmark> wall(4000);
  for (Landmark& landmark : wall) {
    landmark.p_session = {rng.Uniform(-3, 9), rng.Uniform(-1.5, 1.5), rng.Uniform(2.5, 3.5)};
    for (uint64_t& word : landmark.descriptor.words) word = rng.Next();
  }
  return wall;
}

/// Stands for your system: it has a pose, makes keyframes, and can localise on points it is given.
class ToySlam final : public mapp::SlamAdapter {
 public:
  // Called on the participant's thread: take the value, act on it in the tracking thread.
  void TakeSharedMap(std::shared_ptr<const mapp::SharedMap> map) override {
    const std::lock_guard<std::mutex> lock(mutex_);
    shared_map_ = std::move(map);
  }
  void LeaveSharedMap() override {
    const std::lock_guard<std::mutex> lock(mutex_);
    shared_map_ = nullptr;
  }

  void Step() {
    ++step_;
    T_session_camera_ = mapp::Pose3(Eigen::Quaterniond::Identity(), {kStepM * step_, 0, 0});
  }

  /// While a shared map serves: how many of its points this frame matches.
  std::optional<mapp::SharedMapFrame> LocalizeOnSharedMap() const {
    std::shared_ptr<const mapp::SharedMap> map;
    {
      const std::lock_guard<std::mutex> lock(mutex_);
      map = shared_map_;
    }
    if (map == nullptr) return std::nullopt;
    mapp::SharedMapFrame frame;
    frame.shared_map_number = map->number;
    frame.T_session_camera = T_session_camera_;
    for (const mapp::SharedPoint& point : map->points) frame.num_matches += IsVisible(point.p_session) ? 1 : 0;
    frame.localized = frame.num_matches >= kMinMatches;
    return frame;
  }

  /// A whole keyframe of the present frame: its features, and the map points behind them.
  mapp::Keyframe MakeKeyframe() const {
    mapp::Keyframe keyframe;
    keyframe.number = static_cast<uint32_t>(step_);
    keyframe.stamp_ns = int64_t{step_} * 100'000'000;
    keyframe.T_frame_camera = T_session_camera_;
    const mapp::Pose3 T_camera_session = T_session_camera_.Inverse();
    for (size_t i = 0; i < wall_.size() && keyframe.features.size() < mapp::kMaxFeatures; ++i) {
      if (!IsVisible(wall_[i].p_session)) continue;
      const Eigen::Vector3d p_camera = T_camera_session * wall_[i].p_session;
      const Eigen::Vector2d pixel = camera_.Project(p_camera);
      mapp::KeyframeFeature feature;
      feature.keypoint.u_px = static_cast<float>(pixel.x());
      feature.keypoint.v_px = static_cast<float>(pixel.y());
      feature.descriptor = wall_[i].descriptor;
      // `id` is the system's own number for the point: the same one in every keyframe that observes it.
      feature.point = mapp::PointReference{.kind = mapp::PointReference::Kind::kSessionPoint,
                                           .id = i,
                                           .depth_m = static_cast<float>(p_camera.z()),
                                           .num_observations = 1};
      keyframe.features.push_back(feature);
    }
    return keyframe;
  }

  const mapp::Camera& camera() const { return camera_; }
  int step() const { return step_; }

 private:
  bool IsVisible(const Eigen::Vector3d& p_session) const {
    const Eigen::Vector3d p_camera = T_session_camera_.Inverse() * p_session;
    return p_camera.z() > 0 && camera_.Contains(camera_.Project(p_camera));
  }

  const mapp::Camera camera_ = MakeCamera();
  const std::vector<Landmark> wall_ = MakeWall();
  int step_ = -1;
  mapp::Pose3 T_session_camera_;
  mutable std::mutex mutex_;
  std::shared_ptr<const mapp::SharedMap> shared_map_;
};

mapp::Status Run(const std::string& map_name, const std::string& server) {
  ToySlam slam;
  mapp::MapClientOptions client;
  client.server_address = server;
  mapp::ParticipantOptions options;
  options.map_name = map_name;
  options.device = "example 02";
  // Its descriptors are its own and it has no pyramid: the map is then for devices that extract the same.
  options.features = {.descriptor_kind = "example-02", .num_levels = 1};
  MAPP_ASSIGN_OR_RETURN(const std::unique_ptr<mapp::Participant> participant,
                        mapp::Participant::Open(client, options, slam.camera(), mapp::SensorKind::kRgbd, &slam));

  // A system that loses its place for good and starts over, with a new map in a new frame, calls
  // participant->BeginFragment() first, then drops the shared map it may hold; this one never gets lost.
  while (slam.step() + 1 < kNumSteps) {
    slam.Step();
    const std::optional<mapp::SharedMapFrame> on_shared_map = slam.LocalizeOnSharedMap();
    if (on_shared_map) {
      // Mapping rests. A frame that fails makes the participant ask for another map, or end the sharing.
      participant->OnSharedMapFrame(*on_shared_map, [&] { return std::optional(slam.MakeKeyframe()); });
    } else {
      participant->OnKeyframe(slam.MakeKeyframe());
    }
    // Only so that the printed steps are the same in every run; a live system never waits.
    MAPP_RETURN_IF_ERROR(participant->WaitIdle(seconds(30)));
    std::printf("step %2d: %s\n", slam.step(),
                on_shared_map ? "localised on the shared map" : "keyframe handed to the participant");
  }
  MAPP_RETURN_IF_ERROR(participant->Close(seconds(60), /*wait_for_optimization=*/true));
  const mapp::ParticipantStats stats = participant->stats();
  std::printf("%llu keyframes, %llu uploaded, %llu bytes up instead of %llu\n",
              static_cast<unsigned long long>(stats.num_keyframes), static_cast<unsigned long long>(stats.num_uploaded),
              static_cast<unsigned long long>(stats.traffic.upload_bytes),
              static_cast<unsigned long long>(stats.full.bytes));
  return absl::OkStatus();
}

}  // namespace

int main(int argc, char** argv) {
  if (argc < 2 || argc > 3) {
    std::fprintf(stderr, "usage: %s MAP_NAME [SERVER]\n", argv[0]);
    return 2;
  }
  const mapp::Status status = Run(argv[1], argc == 3 ? argv[2] : "127.0.0.1:7878");
  if (status.ok()) return 0;
  std::fprintf(stderr, "%s\n", status.ToString().c_str());
  return 1;
}
