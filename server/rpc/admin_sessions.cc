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

grpc::Status AdminServiceHandler::RevertSession(grpc::ServerContext* context, const v1::RevertSessionRequest* request,
                                                v1::RevertSessionResponse* response) {
  return runner_.Unary("RevertSession", *context, *request, *response, [&](const Call& call) -> Status {
    MAPP_ASSIGN_OR_RETURN(const SessionId session, SessionIdFromProto(request->session_id(), "session_id"));
    MAPP_ASSIGN_OR_RETURN(const RevertedSession reverted,
                          service_.RevertSession(call.context, session, request->reason(), request->dry_run()));
    response->set_map_revision(reverted.map_revision.value());
    response->set_num_frames(reverted.num_frames);
    response->set_num_points(reverted.num_points);
    response->set_num_sessions_to_optimize(reverted.num_sessions_to_optimize);
    if (!request->dry_run()) {
      log::Info("session_reverted",
                {{"session", session.value()}, {"frames", reverted.num_frames}, {"points", reverted.num_points}});
    }
    return absl::OkStatus();
  });
}

grpc::Status AdminServiceHandler::EraseSession(grpc::ServerContext* context, const v1::EraseSessionRequest* request,
                                               v1::EraseSessionResponse* response) {
  return runner_.Unary("EraseSession", *context, *request, *response, [&](const Call& call) -> Status {
    MAPP_ASSIGN_OR_RETURN(const SessionId session, SessionIdFromProto(request->session_id(), "session_id"));
    MAPP_ASSIGN_OR_RETURN(ErasedSession erased,
                          service_.EraseSession(call.context, session, request->force(), request->dry_run()));
    response->set_map_revision(erased.map_revision.value());
    response->set_num_frames(erased.num_frames);
    response->set_num_points(erased.num_points);
    response->set_num_points_kept(erased.num_points_kept);
    for (std::string& tag : erased.dropped_tags) response->add_dropped_tags(std::move(tag));
    if (!request->dry_run()) {
      log::Info("session_erased",
                {{"session", session.value()}, {"frames", erased.num_frames}, {"points", erased.num_points}});
    }
    return absl::OkStatus();
  });
}

}  // namespace mapp
