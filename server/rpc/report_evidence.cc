#include "api/convert/convert.h"
#include "server/rpc/map_service_handler.h"

namespace mapp {

grpc::Status MapServiceHandler::ReportEvidence(grpc::ServerContext* context, const v1::ReportEvidenceRequest* request,
                                               v1::ReportEvidenceResponse* response) {
  return runner_.Unary("ReportEvidence", *context, *request, *response, [&](const Call& call) -> Status {
    MAPP_ASSIGN_OR_RETURN(const SessionId session, SessionIdFromProto(request->session_id(), "session_id"));
    MAPP_ASSIGN_OR_RETURN(const StoredEvidence stored,
                          service_.ReportEvidence(call.context, session, request->number(), request->evidence()));
    response->set_already_stored(stored.already_stored);
    response->set_num_points(static_cast<uint32_t>(stored.num_points));
    response->set_num_unknown_points(static_cast<uint32_t>(stored.num_unknown_points));
    return absl::OkStatus();
  });
}

}  // namespace mapp
