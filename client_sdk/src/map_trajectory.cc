#include "mapp/client/device.h"

#include <algorithm>
#include <cmath>
#include <utility>

namespace mapp {
namespace {

/// What T_map_session was at a moment of the way.
struct Anchor {
  int64_t stamp_ns = 0;
  Pose3 T_map_session;
};

/// The trajectory with lengths in the map's unit, as if the device had told them so.
std::vector<TrajectoryPose> InMapUnit(const DeviceFragment& fragment) {
  std::vector<TrajectoryPose> trajectory = fragment.trajectory;
  for (TrajectoryPose& pose : trajectory) {
    pose.T_session_camera = Pose3(pose.T_session_camera.rotation(),
                                  fragment.session.scale_map_session * pose.T_session_camera.translation());
  }
  return trajectory;
}

/// One for each keyframe that the map holds and each frame localised on a shared map, by time.
std::vector<Anchor> AnchorsOf(const std::vector<TrajectoryPose>& trajectory,
                              std::vector<ClientKeyframePose> keyframes) {
  std::ranges::sort(keyframes, {}, &ClientKeyframePose::stamp_ns);
  std::vector<Anchor> anchors;
  for (const TrajectoryPose& pose : trajectory) {
    if (pose.T_map_session) {
      anchors.push_back({pose.stamp_ns, *pose.T_map_session});
      continue;
    }
    const auto keyframe = std::ranges::lower_bound(keyframes, pose.stamp_ns, {}, &ClientKeyframePose::stamp_ns);
    if (keyframe == keyframes.end() || keyframe->stamp_ns != pose.stamp_ns) continue;
    anchors.push_back({pose.stamp_ns, keyframe->T_map_camera * pose.T_session_camera.Inverse()});
  }
  return anchors;
}

Pose3 Interpolate(const Pose3& a, const Pose3& b, double share_of_b) {
  return Pose3(a.rotation().slerp(share_of_b, b.rotation()),
               (1 - share_of_b) * a.translation() + share_of_b * b.translation());
}

/// The camera's pose by the anchors before and after it; at least one is needed.
Pose3 PoseByAnchors(const std::vector<Anchor>& anchors, const TrajectoryPose& pose) {
  const auto next = std::ranges::lower_bound(anchors, pose.stamp_ns, {}, &Anchor::stamp_ns);
  if (next == anchors.end()) return anchors.back().T_map_session * pose.T_session_camera;
  if (next == anchors.begin() || next->stamp_ns == pose.stamp_ns) return next->T_map_session * pose.T_session_camera;
  const auto previous = std::prev(next);
  const double share = static_cast<double>(pose.stamp_ns - previous->stamp_ns) /
                       static_cast<double>(next->stamp_ns - previous->stamp_ns);
  // At the camera: between two alignments far from the session's origin, a small turn would be a large shift.
  return Interpolate(previous->T_map_session * pose.T_session_camera, next->T_map_session * pose.T_session_camera,
                     share);
}

}  // namespace

std::vector<TrajectoryPose> TrajectoryInMap(const DeviceFragment& fragment) {
  const std::optional<Pose3>& T_map_session = fragment.session.T_map_session;
  if (!T_map_session) return {};
  std::vector<TrajectoryPose> in_map = InMapUnit(fragment);
  std::vector<Anchor> anchors;
  if (!fragment.keyframe_poses.empty()) anchors = AnchorsOf(in_map, fragment.keyframe_poses);
  for (TrajectoryPose& pose : in_map) {
    if (pose.T_map_session) {
      pose.T_session_camera = *pose.T_map_session * pose.T_session_camera;
    } else {
      pose.T_session_camera = anchors.empty() ? *T_map_session * pose.T_session_camera : PoseByAnchors(anchors, pose);
    }
  }
  return in_map;
}

std::optional<std::vector<TrajectoryPose>> TrajectoryInMap(const std::vector<DeviceFragment>& fragments) {
  std::optional<std::vector<TrajectoryPose>> in_map;
  for (const DeviceFragment& fragment : fragments) {
    if (!fragment.session.T_map_session) continue;
    if (!in_map) in_map.emplace();
    const std::vector<TrajectoryPose> poses = TrajectoryInMap(fragment);
    in_map->insert(in_map->end(), poses.begin(), poses.end());
  }
  return in_map;
}

Status FetchKeyframePoses(Participant& participant, std::vector<DeviceFragment>& fragments) {
  MAPP_ASSIGN_OR_RETURN(std::vector<std::vector<ClientKeyframePose>> poses, participant.FetchKeyframePoses());
  // A fragment may have begun since.
  for (size_t i = 0; i < std::min(poses.size(), fragments.size()); ++i) {
    fragments[i].keyframe_poses = std::move(poses[i]);
  }
  return absl::OkStatus();
}

}  // namespace mapp
