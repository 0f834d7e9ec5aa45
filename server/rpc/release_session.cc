#include "api/convert/convert.h"
#include "log/log.h"
#include "server/rpc/admin_service_handler.h"

namespace mapp {

grpc::Status AdminServiceHandler::ReleaseSession(grpc::ServerContext* context, const v1::ReleaseSessionRequest* request,
                                                 v1::ReleaseSessionResponse* response) {
  return runner_.Unary("ReleaseSession", *context, *request, *response, [&](const Call& call) -> Status {
    MAPP_ASSIGN_OR_RETURN(const SessionId session, SessionIdFromProto(request->session_id(), "session_id"));
    MAPP_ASSIGN_OR_RETURN(const ReleasedSession released, service_.ReleaseSession(call.context, session));
    response->set_num_frames(released.num_frames_taken_in);
    log::Info("session_released", {{"session", session.value()}, {"frames", released.num_frames_taken_in}});
    return absl::OkStatus();
  });
}

}  // namespace mapp
