#include "api/convert/convert.h"
#include "server/rpc/map_service_handler.h"

namespace mapp {

grpc::Status MapServiceHandler::CloseSession(grpc::ServerContext* context, const v1::CloseSessionRequest* request,
                                             v1::CloseSessionResponse* response) {
  return runner_.Unary("CloseSession", *context, *request, *response, [&](const Call& call) -> Status {
    MAPP_ASSIGN_OR_RETURN(const SessionId session, SessionIdFromProto(request->session_id(), "session_id"));
    MAPP_ASSIGN_OR_RETURN(const ClosedSession closed, service_.CloseSession(call.context, session));
    response->set_num_keyframes(static_cast<uint64_t>(closed.num_keyframes));
    response->set_optimization_pending(closed.optimization_pending);
    return absl::OkStatus();
  });
}

}  // namespace mapp
