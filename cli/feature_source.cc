#include "cli/feature_source.h"

#include "sim_device/feature_device.h"

#include <utility>

namespace mapp {
namespace {

class FeatureReplayDevice final : public ReplayDevice {
 public:
  FeatureReplayDevice(const sim::Visit& visit, std::unique_ptr<sim::FeatureDevice> device)
      : visit_(visit), device_(std::move(device)) {}

  StatusOr<PlayedStep> Play(size_t frame_idx) override {
    const StampedPose& pose = visit_.poses.at(frame_idx);
    return PlayedStep{.tracking = device_->Step(pose.T_world_camera, pose.stamp_ns)};
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
  bool metric() const override { return true; }
  KeyframeTotals keyframe_equivalents() const override { return device_->keyframe_equivalents(); }
  LocalMappingStats local_mapping() const override { return {}; }

 private:
  const sim::Visit& visit_;
  std::unique_ptr<sim::FeatureDevice> device_;
};

class FeatureSource final : public ReplaySource {
 public:
  FeatureSource(std::string name, std::shared_ptr<const sim::FeatureWorld> world, sim::Visit visit, uint64_t seed)
      : name_(std::move(name)), world_(std::move(world)), visit_(std::move(visit)), seed_(seed) {}

  const std::string& name() const override { return name_; }
  size_t num_frames() const override { return visit_.poses.size(); }
  int64_t stamp_ns(size_t frame_idx) const override { return visit_.poses.at(frame_idx).stamp_ns; }
  const std::vector<StampedPose>& ground_truth() const override { return visit_.poses; }
  StatusOr<std::unique_ptr<ReplayDevice>> Open(const MapClientOptions& client_options,
                                               const ParticipantOptions& options) const override {
    sim::FeatureTrackerOptions tracker_options;
    tracker_options.seed = seed_;
    MAPP_ASSIGN_OR_RETURN(auto device,
                          sim::FeatureDevice::Open(world_, visit_.rig, tracker_options, client_options, options));
    return std::make_unique<FeatureReplayDevice>(visit_, std::move(device));
  }

 private:
  const std::string name_;
  const std::shared_ptr<const sim::FeatureWorld> world_;
  const sim::Visit visit_;
  const uint64_t seed_;
};

}  // namespace

std::unique_ptr<ReplaySource> MakeFeatureSource(std::string name, std::shared_ptr<const sim::FeatureWorld> world,
                                                sim::Visit visit, uint64_t seed) {
  return std::make_unique<FeatureSource>(std::move(name), std::move(world), std::move(visit), seed);
}

}  // namespace mapp
