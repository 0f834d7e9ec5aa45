#include "api/convert/convert.h"
#include "server/rpc/map_service_handler.h"

namespace mapp {
namespace {

v1::UpdateVerdict ToProto(UpdateVerdict verdict) {
  switch (verdict) {
    case UpdateVerdict::kNone:
      return v1::UPDATE_VERDICT_NONE;
    case UpdateVerdict::kExpansion:
      return v1::UPDATE_VERDICT_EXPANSION;
    case UpdateVerdict::kUpdating:
      return v1::UPDATE_VERDICT_UPDATING;
  }
  return v1::UPDATE_VERDICT_UNSPECIFIED;
}

}  // namespace

grpc::Status MapServiceHandler::ReportUpdate(grpc::ServerContext* context, const v1::ReportUpdateRequest* request,
                                             v1::ReportUpdateResponse* response) {
  return runner_.Unary("ReportUpdate", *context, *request, *response, [&](const Call& call) -> Status {
    MAPP_ASSIGN_OR_RETURN(const SessionId session, SessionIdFromProto(request->session_id(), "session_id"));
    const std::vector<std::string> packets(request->keyframes().begin(), request->keyframes().end());
    MAPP_ASSIGN_OR_RETURN(const UpdateResult result, service_.ReportUpdate(call.context, session, packets));
    response->set_verdict(ToProto(result.verdict));
    for (const MapPointId point : result.missing_points) response->add_missing_points(point.value());
    for (const Aabb& box : result.missing_boxes) *response->add_missing_boxes() = mapp::ToProto(box);
    response->set_new_share(static_cast<float>(result.new_share));
    return absl::OkStatus();
  });
}

}  // namespace mapp
