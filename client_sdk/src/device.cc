#include "mapp/client/device.h"

#include "alignment_in_use.h"

#include <utility>

namespace mapp {

struct Device::Impl {
  std::unique_ptr<OrbTracker> tracker;
  std::unique_ptr<Participant> participant;  // ends first: it calls the tracker
  KeyframeTotals keyframe_equivalents;
  AlignmentInUse alignment;
  std::vector<std::vector<TrajectoryPose>> ended_trajectories;

  /// Goes on in a new session where the tracker has begun a new fragment.
  void FollowRestarts() {
    for (EndedFragment& ended : tracker->TakeEndedFragments()) {
      for (Keyframe& keyframe : ended.keyframes) participant->OnKeyframe(std::move(keyframe));
      participant->BeginFragment();
      tracker->LeaveSharedMap();  // one may have arrived while the tracker restarted
      ended_trajectories.push_back(std::move(ended.trajectory));
    }
  }

  /// Hands the keyframes that local mapping has finished to the participant.
  void HandOverKeyframes() {
    for (Keyframe& keyframe : tracker->TakeKeyframes()) participant->OnKeyframe(std::move(keyframe));
  }

  void ReportSharedMapFrame(const TrackingResult& result) {
    const SharedMapFrame frame{.shared_map_number = result.shared_map_number,
                               .num_matches = result.num_shared_matches,
                               .localized = result.on_shared_map,
                               .T_session_camera = result.T_session_camera};
    participant->OnSharedMapFrame(frame, [this] { return tracker->MakeKeyframeOfLastFrame(); });
  }

  void CountKeyframeEquivalent() {
    const std::optional<Keyframe> keyframe = tracker->MakeKeyframeOfLastFrame();
    if (keyframe) keyframe_equivalents += KeyframeTotals::Of(*keyframe);
  }
};

StatusOr<std::unique_ptr<Device>> Device::Open(std::unique_ptr<OrbTracker> tracker,
                                               const MapClientOptions& client_options,
                                               const ParticipantOptions& options) {
  if (tracker == nullptr) return absl::InvalidArgumentError("tracker: must be given");
  auto impl = std::make_unique<Impl>();
  impl->tracker = std::move(tracker);
  ParticipantOptions with_features = options;
  with_features.features = impl->tracker->feature_settings();
  MAPP_ASSIGN_OR_RETURN(impl->participant, Participant::Open(client_options, with_features, impl->tracker->camera(),
                                                             impl->tracker->sensor(), impl->tracker.get()));
  return std::unique_ptr<Device>(new Device(std::move(impl)));
}

Device::Device(std::unique_ptr<Impl> impl) : impl_(std::move(impl)) {}
Device::~Device() = default;

StatusOr<DevicePose> Device::Track(const TrackerFrame& frame) {
  DevicePose pose;
  MAPP_ASSIGN_OR_RETURN(pose.tracking, impl_->tracker->Track(frame));
  impl_->FollowRestarts();
  impl_->HandOverKeyframes();
  if (pose.tracking.shared_map_number > 0) impl_->ReportSharedMapFrame(pose.tracking);
  if (pose.tracking.would_be_keyframe) impl_->CountKeyframeEquivalent();
  if (pose.tracking.state != TrackingState::kTracking) return pose;
  pose.T_odometry_camera = pose.tracking.T_odometry_session * pose.tracking.T_session_camera;
  const std::optional<Sim3> S_map_session = impl_->alignment.For(pose.tracking, impl_->participant->S_map_session());
  if (S_map_session) pose.T_map_camera = *S_map_session * pose.tracking.T_session_camera;
  return pose;
}

Status Device::WaitIdle(std::chrono::milliseconds timeout) {
  impl_->tracker->WaitForLocalMapping();
  impl_->HandOverKeyframes();
  return impl_->participant->WaitIdle(timeout);
}

Status Device::Close(std::chrono::milliseconds timeout, bool wait_for_optimization) {
  impl_->tracker->WaitForLocalMapping();
  impl_->HandOverKeyframes();
  return impl_->participant->Close(timeout, wait_for_optimization);
}

std::vector<DeviceFragment> Device::fragments() const {
  std::vector<DeviceFragment> fragments;
  for (const ParticipantFragment& session : impl_->participant->fragments()) {
    const size_t i = fragments.size();
    fragments.push_back(
        {session,
         i < impl_->ended_trajectories.size() ? impl_->ended_trajectories[i] : impl_->tracker->Trajectory(),
         {}});
  }
  return fragments;
}

Status Device::FetchKeyframePoses(std::vector<DeviceFragment>& fragments) {
  return mapp::FetchKeyframePoses(*impl_->participant, fragments);
}

const OrbTracker& Device::tracker() const { return *impl_->tracker; }
const Participant& Device::participant() const { return *impl_->participant; }
const KeyframeTotals& Device::keyframe_equivalents() const { return impl_->keyframe_equivalents; }

}  // namespace mapp
