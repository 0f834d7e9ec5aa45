#include "mapp/base/rng.h"
#include "sim/renderer.h"
#include "sim/room.h"
#include "sim/sequence_writer.h"

#include <fmt/format.h>

#include <utility>

namespace mapp::sim {
namespace {

constexpr double kRateHz = 15;
constexpr int kMaxThreads = 256;
constexpr int kMaxSession = 1'000'000;  // their times follow each other

class RoomSequence final : public Sequence {
 public:
  RoomSequence(std::shared_ptr<const Scene> scene, const RoomOptions& options)
      : options_(options),
        camera_(RoomCamera()),
        renderer_(MakeRasterRenderer(std::move(scene), options.num_threads)),
        poses_(RoomTrajectory(options.session)) {}

  const std::string& name() const override { return name_; }
  SensorKind sensor() const override { return SensorKind::kRgbd; }
  const Camera& camera() const override { return camera_; }
  const std::optional<Camera>& right_camera() const override { return no_camera_; }
  const Pose3& T_left_right() const override { return identity_; }
  size_t num_frames() const override { return poses_.size(); }
  int64_t stamp_ns(size_t frame_idx) const override { return poses_.at(frame_idx).stamp_ns; }
  const std::vector<StampedPose>& ground_truth() const override { return poses_; }

  StatusOr<SequenceFrame> Read(size_t frame_idx) const override {
    if (frame_idx >= poses_.size()) {
      return absl::OutOfRangeError(fmt::format("{}: frame {} of {}", name_, frame_idx, poses_.size()));
    }
    const StampedPose& pose = poses_[frame_idx];
    MAPP_ASSIGN_OR_RETURN(RenderedFrame rendered, renderer_->Render(camera_, pose.T_world_camera));
    // The time is different in every session, so the noise is as well.
    AddSensorNoise(options_.noise, Rng(options_.seed ^ static_cast<uint64_t>(pose.stamp_ns)).Next(), rendered);
    return SequenceFrame{pose.stamp_ns, std::move(rendered.gray), std::move(rendered.depth_m), {}};
  }

 private:
  const std::string name_ = "room";
  const RoomOptions options_;
  const Camera camera_;
  const std::optional<Camera> no_camera_;
  const Pose3 identity_;
  const std::unique_ptr<Renderer> renderer_;
  const std::vector<StampedPose> poses_;
};

Status CheckOptions(const RoomOptions& options) {
  if (options.session < 0 || options.session > kMaxSession) {
    return absl::InvalidArgumentError(fmt::format("session: must be in [0, {}], got {}", kMaxSession, options.session));
  }
  if (options.num_threads < 1 || options.num_threads > kMaxThreads) {
    return absl::InvalidArgumentError(
        fmt::format("num_threads: must be in [1, {}], got {}", kMaxThreads, options.num_threads));
  }
  return absl::OkStatus();
}

}  // namespace

Camera RoomCamera() {
  Camera camera;
  camera.projection = PinholeCamera{525, 525, 319.5, 239.5};
  camera.width_px = 640;
  camera.height_px = 480;
  return camera;
}

StatusOr<std::unique_ptr<Sequence>> MakeRoomSequence(const RoomOptions& options) {
  MAPP_RETURN_IF_ERROR(CheckOptions(options));
  MAPP_ASSIGN_OR_RETURN(std::shared_ptr<const Scene> scene, BuildRoom(options.seed));
  return std::make_unique<RoomSequence>(std::move(scene), options);
}

Status WriteRoomSequence(const std::string& folder, const RoomOptions& options,
                         const std::function<bool(size_t num_written)>& progress) {
  MAPP_ASSIGN_OR_RETURN(const std::unique_ptr<Sequence> sequence, MakeRoomSequence(options));
  SequenceWriterOptions writer;
  writer.rate_hz = kRateHz;
  writer.progress = progress;
  return WriteSequence(*sequence, folder, writer);
}

}  // namespace mapp::sim
