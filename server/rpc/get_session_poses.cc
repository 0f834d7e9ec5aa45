#include "api/convert/convert.h"
#include "server/rpc/map_service_handler.h"

namespace mapp {

grpc::Status MapServiceHandler::GetSessionPoses(grpc::ServerContext* context, const v1::GetSessionPosesRequest* request,
                                                v1::GetSessionPosesResponse* response) {
  return runner_.Unary("GetSessionPoses", *context, *request, *response, [&](const Call& call) -> Status {
    MAPP_ASSIGN_OR_RETURN(const SessionId session, SessionIdFromProto(request->session_id(), "session_id"));
    MAPP_ASSIGN_OR_RETURN(const SessionPoses poses, service_.GetSessionPoses(call.context, session));
    for (const FrameRecord& frame : poses.frames) {
      v1::GetSessionPosesResponse::KeyframePose& keyframe = *response->add_keyframes();
      keyframe.set_keyframe(frame.number);
      keyframe.set_stamp_ns(frame.stamp_ns);
      *keyframe.mutable_pose_map_camera() = ToProto(frame.T_frame_camera);
    }
    response->set_map_revision(poses.map_revision.value());
    return absl::OkStatus();
  });
}

}  // namespace mapp
