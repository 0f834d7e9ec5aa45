// DetectChanges, ListChanges and what operators decide on them.

#include "server/rpc/admin_service_handler.h"
#include "server/rpc/record_protos.h"

#include <google/protobuf/repeated_field.h>

#include <chrono>
#include <vector>

namespace mapp {
namespace {

v1::DetectChangesResponse ProgressMessage(const ScanProgress& progress) {
  v1::DetectChangesResponse message;
  message.mutable_progress()->set_num_sessions_done(static_cast<uint32_t>(progress.num_sessions_done));
  message.mutable_progress()->set_num_sessions(static_cast<uint32_t>(progress.num_sessions));
  return message;
}

v1::DetectChangesResponse ResultMessage(const DetectedChanges& detected, std::chrono::steady_clock::duration elapsed) {
  v1::DetectChangesResponse message;
  v1::DetectChangesResponse::Result& result = *message.mutable_result();
  for (const ChangeRecord& change : detected.changes) *result.add_changes() = ToProto(change);
  result.set_num_new(static_cast<uint32_t>(detected.num_new));
  result.set_num_dropped(static_cast<uint32_t>(detected.num_dropped));
  result.set_num_accepted(static_cast<uint32_t>(detected.num_accepted));
  result.set_num_sessions_read(static_cast<uint32_t>(detected.num_sessions_read));
  result.set_num_sessions(static_cast<uint32_t>(detected.num_sessions));
  result.set_seconds(std::chrono::duration<double>(elapsed).count());
  return message;
}

/// INVALID_ARGUMENT when there are none.
StatusOr<std::vector<ChangeId>> ChangeIds(const google::protobuf::RepeatedField<uint64_t>& ids) {
  if (ids.empty()) return absl::InvalidArgumentError("ids: name at least one change");
  std::vector<ChangeId> changes;
  for (const uint64_t id : ids) changes.emplace_back(id);
  return changes;
}

void Fill(const ChangeDecision& decision, v1::DecideChangesResponse& response) {
  for (const ChangeRecord& change : decision.changes) *response.add_changes() = ToProto(change);
  response.set_map_revision(decision.revision.value());
  response.set_num_points(decision.num_points);
}

}  // namespace

grpc::Status AdminServiceHandler::DetectChanges(grpc::ServerContext* context, const v1::DetectChangesRequest* request,
                                                grpc::ServerWriter<v1::DetectChangesResponse>* writer) {
  return runner_.Stream("DetectChanges", *context, *request, [&](Call& call) -> Status {
    const auto send = [&](const v1::DetectChangesResponse& message) {
      if (!writer->Write(message)) return false;
      call.streamed_bytes += message.ByteSizeLong();
      return true;
    };
    const auto start = std::chrono::steady_clock::now();
    ChangeSearch search{.map_name = request->name(), .auto_accept = request->auto_accept()};
    if (request->from_unix_ns() != 0) search.from_ns = request->from_unix_ns();
    if (request->to_unix_ns() != 0) search.to_ns = request->to_unix_ns();
    // A caller that is gone cancels call.context.
    const auto tell = [&](const ScanProgress& progress) { send(ProgressMessage(progress)); };
    MAPP_ASSIGN_OR_RETURN(const DetectedChanges detected, service_.DetectChanges(call.context, search, tell));
    return send(ResultMessage(detected, std::chrono::steady_clock::now() - start))
               ? absl::OkStatus()
               : absl::CancelledError("the caller is gone");
  });
}

grpc::Status AdminServiceHandler::ListChanges(grpc::ServerContext* context, const v1::ListChangesRequest* request,
                                              v1::ListChangesResponse* response) {
  return runner_.Unary("ListChanges", *context, *request, *response, [&](const Call& call) -> Status {
    MAPP_ASSIGN_OR_RETURN(const std::vector<ChangeRecord> changes, service_.ListChanges(call.context, request->name()));
    for (const ChangeRecord& change : changes) *response->add_changes() = ToProto(change);
    return absl::OkStatus();
  });
}

grpc::Status AdminServiceHandler::AcceptChanges(grpc::ServerContext* context, const v1::AcceptChangesRequest* request,
                                                v1::DecideChangesResponse* response) {
  return runner_.Unary("AcceptChanges", *context, *request, *response, [&](const Call& call) -> Status {
    MAPP_ASSIGN_OR_RETURN(const std::vector<ChangeId> ids, ChangeIds(request->ids()));
    MAPP_ASSIGN_OR_RETURN(const ChangeDecision decision, service_.AcceptChanges(call.context, request->name(), ids));
    Fill(decision, *response);
    return absl::OkStatus();
  });
}

grpc::Status AdminServiceHandler::RejectChanges(grpc::ServerContext* context, const v1::RejectChangesRequest* request,
                                                v1::DecideChangesResponse* response) {
  return runner_.Unary("RejectChanges", *context, *request, *response, [&](const Call& call) -> Status {
    MAPP_ASSIGN_OR_RETURN(const std::vector<ChangeId> ids, ChangeIds(request->ids()));
    MAPP_ASSIGN_OR_RETURN(const ChangeDecision decision, service_.RejectChanges(call.context, request->name(), ids));
    Fill(decision, *response);
    return absl::OkStatus();
  });
}

grpc::Status AdminServiceHandler::UndoChanges(grpc::ServerContext* context, const v1::UndoChangesRequest* request,
                                              v1::DecideChangesResponse* response) {
  return runner_.Unary("UndoChanges", *context, *request, *response, [&](const Call& call) -> Status {
    MAPP_ASSIGN_OR_RETURN(const std::vector<ChangeId> ids, ChangeIds(request->ids()));
    MAPP_ASSIGN_OR_RETURN(const ChangeDecision decision, service_.UndoChanges(call.context, request->name(), ids));
    Fill(decision, *response);
    return absl::OkStatus();
  });
}

}  // namespace mapp
