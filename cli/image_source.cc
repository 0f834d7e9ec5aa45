#include "cli/image_source.h"

#include "mapp/base/process_usage.h"

#include <utility>

namespace mapp {
namespace {

class ImageDevice final : public ReplayDevice {
 public:
  ImageDevice(const Sequence& sequence, std::unique_ptr<Device> device)
      : sequence_(sequence), device_(std::move(device)) {}

  StatusOr<PlayedStep> Play(size_t frame_idx) override {
    const double cpu_before_s = GetProcessUsage().cpu_s;
    MAPP_ASSIGN_OR_RETURN(const SequenceFrame frame, sequence_.Read(frame_idx));
    const double reading_cpu_s = GetProcessUsage().cpu_s - cpu_before_s;
    MAPP_ASSIGN_OR_RETURN(const DevicePose pose, device_->Track({frame.stamp_ns, frame.gray.View(),
                                                                 frame.depth_m.View(), frame.right_gray.View()}));
    return PlayedStep{pose.tracking, reading_cpu_s};
  }
  Status WaitIdle(std::chrono::milliseconds timeout) override { return device_->WaitIdle(timeout); }
  Status Close(std::chrono::milliseconds timeout, bool wait_for_optimization) override {
    return device_->Close(timeout, wait_for_optimization);
  }
  std::vector<DeviceFragment> fragments() const override { return device_->fragments(); }
  Status FetchKeyframePoses(std::vector<DeviceFragment>& fragments) override {
    return device_->FetchKeyframePoses(fragments);
  }
  ParticipantStats stats() const override { return device_->participant().stats(); }
  bool metric() const override { return device_->tracker().sensor() != SensorKind::kMono; }
  KeyframeTotals keyframe_equivalents() const override { return device_->keyframe_equivalents(); }
  LocalMappingStats local_mapping() const override { return device_->tracker().local_mapping(); }

 private:
  const Sequence& sequence_;
  std::unique_ptr<Device> device_;
};

class ImageSource final : public ReplaySource {
 public:
  explicit ImageSource(std::unique_ptr<Sequence> sequence) : sequence_(std::move(sequence)) {}

  const std::string& name() const override { return sequence_->name(); }
  size_t num_frames() const override { return sequence_->num_frames(); }
  int64_t stamp_ns(size_t frame_idx) const override { return sequence_->stamp_ns(frame_idx); }
  const std::vector<StampedPose>& ground_truth() const override { return sequence_->ground_truth(); }
  StatusOr<std::unique_ptr<ReplayDevice>> Open(const MapClientOptions& client_options,
                                               const ParticipantOptions& options) const override {
    MAPP_ASSIGN_OR_RETURN(std::unique_ptr<OrbTracker> tracker, MakeTracker(*sequence_));
    MAPP_ASSIGN_OR_RETURN(auto device, Device::Open(std::move(tracker), client_options, options));
    return std::make_unique<ImageDevice>(*sequence_, std::move(device));
  }

 private:
  std::unique_ptr<Sequence> sequence_;
};

}  // namespace

StatusOr<std::unique_ptr<OrbTracker>> MakeTracker(const Sequence& sequence) {
  switch (sequence.sensor()) {
    case SensorKind::kRgbd:
      return OrbTracker::CreateRgbd(sequence.camera(), {});
    case SensorKind::kStereo:
      return OrbTracker::CreateStereo(sequence.camera(), *sequence.right_camera(), sequence.T_left_right(), {});
    case SensorKind::kMono:
    case SensorKind::kMonoInertial:  // The built-in tracker leaves the inertial readings aside.
      break;
  }
  return OrbTracker::CreateMono(sequence.camera(), {});
}

std::unique_ptr<ReplaySource> MakeImageSource(std::unique_ptr<Sequence> sequence) {
  return std::make_unique<ImageSource>(std::move(sequence));
}

}  // namespace mapp
