#include "server/service/session_view.h"

#include "storage/map_store.h"

#include <fmt/format.h>

#include <utility>

namespace mapp {

StatusOr<SessionView> LoadSession(MapReader& reader, SessionId session) {
  SessionView view;
  MAPP_ASSIGN_OR_RETURN(view.session, reader.GetSession(session));
  MAPP_ASSIGN_OR_RETURN(view.map, reader.GetMap(view.session.map));
  MAPP_ASSIGN_OR_RETURN(CameraRecord camera, reader.GetCamera(view.session.camera));
  view.camera = std::move(camera.camera);
  return view;
}

Status CheckOpen(const SessionRecord& session) {
  if (!session.closed_ns) return absl::OkStatus();
  return absl::FailedPreconditionError(fmt::format("session {} is closed", session.id.value()));
}

void ScaleLengths(Keyframe& keyframe, double scale) {
  if (scale == 1) return;
  if (keyframe.pose_frame == PoseFrame::kSession) {
    keyframe.T_frame_camera = Pose3(keyframe.T_frame_camera.rotation(), scale * keyframe.T_frame_camera.translation());
  }
  for (KeyframeFeature& feature : keyframe.features) {
    if (feature.point) feature.point->depth_m *= static_cast<float>(scale);
  }
}

Status CheckMeasuresDepth(const SessionRecord& session) {
  if (MeasuresDepth(session.sensor)) return absl::OkStatus();
  return absl::FailedPreconditionError(fmt::format(
      "session {} is of a single camera, whose lengths are in a unit of its own: it uploads keyframes whole "
      "and localises on its own map",
      session.id.value()));
}

StatusOr<Pose3> PoseInMap(const SessionRecord& session, PoseFrame pose_frame, const Pose3& T_frame_camera,
                          const std::string& field) {
  if (!session.T_map_session) {
    return absl::FailedPreconditionError(fmt::format("session {} is not aligned with the map yet", session.id.value()));
  }
  const Pose3 T_map_camera = pose_frame == PoseFrame::kMap ? T_frame_camera : *session.T_map_session * T_frame_camera;
  if (!T_map_camera.IsFinite() || T_map_camera.translation().cwiseAbs().maxCoeff() > kMaxCoordinateM) {
    return absl::InvalidArgumentError(
        fmt::format("{}: coordinates in the map must be finite and within {} m", field, kMaxCoordinateM));
  }
  return T_map_camera;
}

StatusOr<MapView> ViewInMap(const SessionView& view, PoseFrame pose_frame, const Pose3& T_frame_camera,
                            const std::string& field) {
  MAPP_ASSIGN_OR_RETURN(const Pose3 T_map_camera, PoseInMap(view.session, pose_frame, T_frame_camera, field));
  return MapView{view.map.id, T_map_camera, view.camera, view.map.cone_range_m, view.map.features.num_levels};
}

}  // namespace mapp
