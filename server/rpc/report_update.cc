#include "api/convert/convert.h"
#include "server/rpc/map_service_handler.h"

#include <fmt/format.h>

namespace mapp {
namespace {

constexpr int kMaxReportedKeyframes = 8;

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

StatusOr<std::vector<std::string>> DecodePackets(const v1::ReportUpdateRequest& request) {
  if (request.keyframes().empty() || request.keyframes_size() > kMaxReportedKeyframes) {
    return absl::InvalidArgumentError(
        fmt::format("keyframes: must be 1 to {}, got {}", kMaxReportedKeyframes, request.keyframes_size()));
  }
  return std::vector<std::string>(request.keyframes().begin(), request.keyframes().end());
}

}  // namespace

grpc::Status MapServiceHandler::ReportUpdate(grpc::ServerContext* context, const v1::ReportUpdateRequest* request,
                                             v1::ReportUpdateResponse* response) {
  return runner_.Unary("ReportUpdate", *context, *request, *response, [&](const Call& call) -> Status {
    MAPP_ASSIGN_OR_RETURN(const SessionId session, SessionIdFromProto(request->session_id(), "session_id"));
    MAPP_ASSIGN_OR_RETURN(const std::vector<std::string> packets, DecodePackets(*request));
    MAPP_ASSIGN_OR_RETURN(const UpdateResult result, service_.ReportUpdate(call.context, session, packets));
    response->set_verdict(ToProto(result.verdict));
    for (const MapPointId point : result.missing_points) response->add_missing_points(point.value());
    for (const Aabb& box : result.missing_boxes) *response->add_missing_boxes() = mapp::ToProto(box);
    response->set_new_share(static_cast<float>(result.new_share));
    return absl::OkStatus();
  });
}

}  // namespace mapp
