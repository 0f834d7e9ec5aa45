#include "api/convert/convert.h"
#include "server/rpc/map_service_handler.h"

#include <fmt/format.h>

namespace mapp {
namespace {

/// K of the paper, and what 0 in the request stands for.
constexpr uint32_t kMaxSamples = 1000;

StatusOr<int> DecodeNumSamples(uint32_t num_samples) {
  if (num_samples > kMaxSamples) {
    return absl::InvalidArgumentError(fmt::format("num_samples: must be at most {}, got {}", kMaxSamples, num_samples));
  }
  return static_cast<int>(num_samples == 0 ? kMaxSamples : num_samples);
}

}  // namespace

grpc::Status MapServiceHandler::AssessOverlap(grpc::ServerContext* context, const v1::AssessOverlapRequest* request,
                                              v1::AssessOverlapResponse* response) {
  return runner_.Unary("AssessOverlap", *context, *request, *response, [&](const Call& call) -> Status {
    MAPP_ASSIGN_OR_RETURN(const SessionId session, SessionIdFromProto(request->session_id(), "session_id"));
    MAPP_ASSIGN_OR_RETURN(const ViewQuery view, DecodeViewQuery(request->view()));
    MAPP_ASSIGN_OR_RETURN(const int num_samples, DecodeNumSamples(request->num_samples()));
    MAPP_ASSIGN_OR_RETURN(const AssessedOverlap assessed,
                          service_.AssessOverlap(call.context, session, view, num_samples));
    response->set_answer(EncodeOverlapAnswer(assessed.answer));
    response->set_map_revision(assessed.map_revision.value());
    return absl::OkStatus();
  });
}

}  // namespace mapp
