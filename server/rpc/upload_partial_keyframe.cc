#include "api/convert/convert.h"
#include "server/rpc/map_service_handler.h"

namespace mapp {

grpc::Status MapServiceHandler::UploadPartialKeyframe(grpc::ServerContext* context,
                                                      const v1::UploadPartialKeyframeRequest* request,
                                                      v1::UploadPartialKeyframeResponse* response) {
  return runner_.Unary("UploadPartialKeyframe", *context, *request, *response, [&](const Call& call) -> Status {
    MAPP_ASSIGN_OR_RETURN(const UploadResult result, service_.UploadKeyframe(call.context, request->keyframe()));
    response->set_frame_id(result.frame.value());
    response->set_already_stored(result.already_stored);
    response->set_map_revision(result.map_revision.value());
    if (result.T_map_session) *response->mutable_pose_map_session() = ToProto(*result.T_map_session);
    if (result.scale_map_session != 1) response->set_scale_map_session(result.scale_map_session);
    return absl::OkStatus();
  });
}

}  // namespace mapp
