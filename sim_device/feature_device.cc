#include "sim_device/feature_device.h"

#include <utility>

namespace mapp::sim {

StatusOr<std::unique_ptr<FeatureDevice>> FeatureDevice::Open(std::shared_ptr<const FeatureWorld> world,
                                                             const CameraRig& rig,
                                                             const FeatureTrackerOptions& tracker_options,
                                                             const MapClientOptions& client_options,
                                                             const ParticipantOptions& options) {
  MAPP_ASSIGN_OR_RETURN(auto tracker, FeatureTracker::Create(std::move(world), rig, tracker_options));
  auto device = std::unique_ptr<FeatureDevice>(new FeatureDevice(std::move(tracker)));
  MAPP_ASSIGN_OR_RETURN(device->participant_, Participant::Open(client_options, options, device->tracker_->camera(),
                                                                device->tracker_->sensor(), device->tracker_.get()));
  return device;
}

FeatureDevice::~FeatureDevice() = default;

TrackingResult FeatureDevice::Step(const Pose3& T_world_camera, int64_t stamp_ns) {
  const TrackingResult result = tracker_->Track(T_world_camera, stamp_ns);
  for (Keyframe& keyframe : tracker_->TakeKeyframes()) participant_->OnKeyframe(std::move(keyframe));
  if (result.shared_map_number > 0) {
    const SharedMapFrame frame{.shared_map_number = result.shared_map_number,
                               .num_matches = result.num_shared_matches,
                               .localized = result.on_shared_map,
                               .T_session_camera = result.T_session_camera};
    participant_->OnSharedMapFrame(frame, [this] { return tracker_->MakeKeyframeOfLastFrame(); });
  }
  if (!result.would_be_keyframe) return result;
  if (const std::optional<Keyframe> keyframe = tracker_->MakeKeyframeOfLastFrame()) {
    keyframe_equivalents_ += KeyframeTotals::Of(*keyframe);
  }
  return result;
}

Status FeatureDevice::WaitIdle(std::chrono::milliseconds timeout) { return participant_->WaitIdle(timeout); }

Status FeatureDevice::Close(std::chrono::milliseconds timeout, bool wait_for_optimization) {
  return participant_->Close(timeout, wait_for_optimization);
}

std::vector<DeviceFragment> FeatureDevice::fragments() const {
  return {{participant_->fragments().front(), tracker_->Trajectory(), {}}};
}

Status FeatureDevice::FetchKeyframePoses(std::vector<DeviceFragment>& fragments) {
  return mapp::FetchKeyframePoses(*participant_, fragments);
}

}  // namespace mapp::sim
