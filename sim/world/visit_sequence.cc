#include "sim/world/visit_sequence.h"

#include "mapp/base/rng.h"
#include "sim/world/motion_spline.h"
#include "sim/world/world_renderer.h"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <utility>
#include <vector>

namespace mapp::sim {
namespace {

constexpr int kMaxThreads = 256;
constexpr int kMaxBlur = 31;

Status CheckOptions(const ImageOptions& options) {
  const auto bad = [](const char* field, const char* range, auto got) {
    return absl::InvalidArgumentError(fmt::format("{}: must be {}, got {}", field, range, got));
  };
  if (!(options.noise.gray_sigma >= 0 && options.noise.gray_sigma <= 255)) {
    return bad("noise.gray_sigma", "in [0, 255]", options.noise.gray_sigma);
  }
  if (!(options.noise.depth_sigma_per_m >= 0 && options.noise.depth_sigma_per_m <= 1)) {
    return bad("noise.depth_sigma_per_m", "in [0, 1]", options.noise.depth_sigma_per_m);
  }
  if (!(options.noise.max_depth_m > 0)) return bad("noise.max_depth_m", "positive", options.noise.max_depth_m);
  if (!(options.exposure > 0 && options.exposure <= 16)) return bad("exposure", "in (0, 16]", options.exposure);
  if (options.motion_blur < 1 || options.motion_blur > kMaxBlur || options.motion_blur % 2 == 0) {
    return bad("motion_blur", "odd and in [1, 31]", options.motion_blur);
  }
  if (options.exposure_s && !(*options.exposure_s >= 0 && *options.exposure_s <= 0.1)) {
    return bad("exposure_s", "in [0, 0.1]", *options.exposure_s);
  }
  if (options.num_threads < 1 || options.num_threads > kMaxThreads) {
    return bad("num_threads", "in [1, 256]", options.num_threads);
  }
  return absl::OkStatus();
}

class DrawnVisit final : public VisitSequence {
 public:
  DrawnVisit(std::shared_ptr<const Simulation> simulation, const Visit& visit, const ImageOptions& options,
             std::optional<MotionSpline> camera_motion)
      : simulation_(std::move(simulation)),
        visit_(visit),
        options_(options),
        exposure_s_(options.exposure_s.value_or(visit.rig.exposure_s)),
        camera_motion_(std::move(camera_motion)),
        name_(fmt::format("{}/{}", simulation_->world->setting, visit.user)),
        renderer_(simulation_->world, options.num_threads, options.with_color) {}

  const std::string& name() const override { return name_; }
  SensorKind sensor() const override { return visit_.rig.sensor; }
  const Camera& camera() const override { return visit_.rig.camera; }
  const std::optional<Camera>& right_camera() const override { return visit_.rig.right_camera; }
  const Pose3& T_left_right() const override { return visit_.rig.T_left_right; }
  size_t num_frames() const override { return visit_.poses.size(); }
  int64_t stamp_ns(size_t frame_idx) const override { return visit_.poses.at(frame_idx).stamp_ns; }
  const std::vector<StampedPose>& ground_truth() const override { return visit_.poses; }

  StatusOr<SequenceFrame> Read(size_t frame_idx) const override {
    MAPP_ASSIGN_OR_RETURN(ColoredFrame drawn, Draw(frame_idx));
    return std::move(drawn.frame);
  }

  StatusOr<ColoredFrame> ReadColored(size_t frame_idx) const override {
    if (!options_.with_color) return absl::FailedPreconditionError(fmt::format("{}: opened without colour", name_));
    return Draw(frame_idx);
  }

 private:
  enum class Eye : uint64_t { kLeft = 0, kRight = 1 };

  StatusOr<ColoredFrame> Draw(size_t frame_idx) const {
    if (frame_idx >= visit_.poses.size()) {
      return absl::OutOfRangeError(fmt::format("{}: frame {} of {}", name_, frame_idx, visit_.poses.size()));
    }
    ColoredFrame drawn;
    drawn.frame.stamp_ns = visit_.poses[frame_idx].stamp_ns;
    MAPP_ASSIGN_OR_RETURN(RenderedFrame left, Take(visit_.poses[frame_idx], Eye::kLeft));
    drawn.frame.gray = std::move(left.gray);
    drawn.color = std::move(left.color);
    if (sensor() == SensorKind::kRgbd) drawn.frame.depth_m = std::move(left.depth_m);
    if (right_camera()) {
      MAPP_ASSIGN_OR_RETURN(RenderedFrame right, Take(visit_.poses[frame_idx], Eye::kRight));
      drawn.frame.right_gray = std::move(right.gray);
    }
    return drawn;
  }

  /// One picture, as the camera's chip takes it.
  StatusOr<RenderedFrame> Take(const StampedPose& pose, Eye eye) const {
    std::vector<Pose3> T_world_camera = PosesWhileOpen(pose);
    if (eye == Eye::kRight) {
      for (Pose3& T_world_eye : T_world_camera) T_world_eye = T_world_eye * T_left_right();
    }
    const Camera& model = eye == Eye::kLeft ? camera() : *right_camera();
    MAPP_ASSIGN_OR_RETURN(RenderedFrame frame, renderer_.Render(model, T_world_camera, pose.stamp_ns));
    if (options_.exposure != 1) ApplyGain(options_.exposure, frame);
    AddNoise(pose.stamp_ns, eye, frame);
    return frame;
  }

  /// Of the left camera, while the shutter is open; the pose itself in the middle.
  std::vector<Pose3> PosesWhileOpen(const StampedPose& pose) const {
    if (!camera_motion_) return {pose.T_world_camera};
    std::vector<Pose3> poses;
    for (int i = 0; i < options_.motion_blur; ++i) {
      const double share = (i + 0.5) / options_.motion_blur - 0.5;
      poses.push_back(camera_motion_->At(pose.stamp_ns + std::llround(share * exposure_s_ * 1e9)).T_world_body);
    }
    poses[poses.size() / 2] = pose.T_world_camera;
    return poses;
  }

  void AddNoise(int64_t stamp_ns, Eye eye, RenderedFrame& frame) const {
    // No two visits share a time, so every picture has noise of its own.
    Rng seed(simulation_->options.seed ^ (2 * static_cast<uint64_t>(stamp_ns) + static_cast<uint64_t>(eye)));
    const GrayImage clean = options_.with_color ? frame.gray : GrayImage();
    AddSensorNoise(options_.noise, seed.Next(), frame);
    for (size_t i = 0; i < frame.color.pixels.size(); ++i) {
      const int noise = int{frame.gray.pixels[i]} - int{clean.pixels[i]};
      for (uint8_t& level : frame.color.pixels[i]) level = static_cast<uint8_t>(std::clamp(level + noise, 0, 255));
    }
  }

  const std::shared_ptr<const Simulation> simulation_;
  const Visit& visit_;
  const ImageOptions options_;
  const double exposure_s_;
  const std::optional<MotionSpline> camera_motion_;  ///< with motion blur only
  const std::string name_;
  const WorldRenderer renderer_;
};

StatusOr<const Visit*> VisitOf(const Simulation& simulation, int user) {
  if (user < 0 || static_cast<size_t>(user) >= simulation.visits.size()) {
    return absl::InvalidArgumentError(fmt::format("user: must be in [0, {}), got {}", simulation.visits.size(), user));
  }
  return &simulation.visits[static_cast<size_t>(user)];
}

}  // namespace

StatusOr<std::unique_ptr<VisitSequence>> OpenVisit(std::shared_ptr<const Simulation> simulation, int user,
                                                   const ImageOptions& options) {
  MAPP_RETURN_IF_ERROR(CheckOptions(options));
  MAPP_ASSIGN_OR_RETURN(const Visit* visit, VisitOf(*simulation, user));
  std::optional<MotionSpline> camera_motion;
  if (options.motion_blur > 1) {
    MAPP_ASSIGN_OR_RETURN(camera_motion, MotionSpline::Through(visit->poses));
  }
  return std::unique_ptr<VisitSequence>(
      std::make_unique<DrawnVisit>(std::move(simulation), *visit, options, std::move(camera_motion)));
}

Status WriteVisit(const std::shared_ptr<const Simulation>& simulation, int user, const ImageOptions& options,
                  const std::string& folder, const std::function<bool(size_t num_written)>& progress) {
  MAPP_ASSIGN_OR_RETURN(const std::unique_ptr<VisitSequence> sequence, OpenVisit(simulation, user, options));
  MAPP_ASSIGN_OR_RETURN(const Visit* visit, VisitOf(*simulation, user));
  SequenceWriterOptions writer;
  writer.rate_hz = visit->rig.rate_hz;
  writer.T_body_camera = visit->rig.T_body_camera;
  writer.imu = visit->imu;
  writer.imu_rate_hz = visit->rig.imu_rate_hz;
  if (options.with_color) writer.read_colored = [&](size_t frame_idx) { return sequence->ReadColored(frame_idx); };
  writer.progress = progress;
  return WriteSequence(*sequence, folder, writer);
}

}  // namespace mapp::sim
