#include "server/service/odometry_links.h"

#include <numbers>

namespace mapp {
namespace {

/// One sigma of the way between two keyframes: what a tracker with depth is off by over any step, and what grows with
/// it. Looser than a tracker's typical step (1.4 to 3.7 mm and 0.02 to 0.04 degrees at the median, in the rendered
/// garage and hall): where observations tell more, they are to decide.
constexpr double kStepM = 0.001;
constexpr double kStepRad = 0.02 * std::numbers::pi / 180.0;
constexpr double kShare = 0.02;
/// Between them the device stopped or began to localise on a shared map: each pose has the map's error there.
constexpr double kRelocalizedM = 0.03;
constexpr double kRelocalizedRad = 0.5 * std::numbers::pi / 180.0;

}  // namespace

void OdometryLinks::Add(int frame_idx, const FrameView& view) {
  sessions_[view.record.session][view.record.number] = {frame_idx, view.keyframe.pose_frame,
                                                        view.keyframe.T_frame_camera};
}

StatusOr<std::vector<BundleProblem::RelativePose>> OdometryLinks::Build(MapReader& reader) const {
  std::vector<BundleProblem::RelativePose> links;
  for (const auto& [id, frames] : sessions_) {
    MAPP_ASSIGN_OR_RETURN(const SessionRecord session, reader.GetSession(id));
    if (session.sensor == SensorKind::kMono) continue;
    const Sent* previous = nullptr;
    for (const auto& [number, sent] : frames) {
      if (previous != nullptr) {
        const bool relocalized = previous->pose_frame != sent.pose_frame;
        const auto in_one_frame = [&](const Sent& frame) {
          return relocalized && frame.pose_frame == PoseFrame::kSession && session.T_map_session
                     ? *session.T_map_session * frame.T_frame_camera
                     : frame.T_frame_camera;
        };
        const Pose3 from = in_one_frame(*previous);
        const Pose3 to = in_one_frame(sent);
        links.push_back({.from_idx = previous->frame_idx,
                         .to_idx = sent.frame_idx,
                         .T_from_to = from.Inverse() * to,
                         .sigma_m = (relocalized ? kRelocalizedM : kStepM) + kShare * Distance(from, to),
                         .sigma_rad = (relocalized ? kRelocalizedRad : kStepRad) + kShare * RotationAngle(from, to)});
      }
      previous = &sent;
    }
  }
  return links;
}

}  // namespace mapp
