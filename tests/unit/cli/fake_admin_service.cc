#include "fake_admin_service.h"

#include <fmt/format.h>
#include <fmt/ranges.h>
#include <grpcpp/server_builder.h>

#include <chrono>

namespace mapp {

FakeAdminService::FakeAdminService() {
  grpc::ServerBuilder builder;
  builder.AddListeningPort("127.0.0.1:0", grpc::InsecureServerCredentials(), &port_);
  builder.RegisterService(this);
  server_ = builder.BuildAndStart();
}

FakeAdminService::~FakeAdminService() {
  server_->Shutdown(std::chrono::system_clock::now());
  server_->Wait();
}

std::string FakeAdminService::address() const { return fmt::format("127.0.0.1:{}", port_); }

grpc::Status FakeAdminService::Check(const std::string& map_name) const {
  if (map_name == now.map().name()) return grpc::Status::OK;
  return {grpc::StatusCode::NOT_FOUND, fmt::format("map \"{}\" does not exist", map_name)};
}

grpc::Status FakeAdminService::ExportMap(grpc::ServerContext* /*context*/, const v1::ExportMapRequest* request,
                                         grpc::ServerWriter<v1::ExportMapResponse>* writer) {
  if (const grpc::Status status = Check(request->name()); !status.ok()) return status;
  export_requests.push_back(request->at());
  if (request->at().empty()) {
    writer->Write(now);
    return grpc::Status::OK;
  }
  const auto found = at.find(request->at());
  if (found == at.end()) return {grpc::StatusCode::OUT_OF_RANGE, "compacted away"};
  writer->Write(found->second);
  return grpc::Status::OK;
}

grpc::Status FakeAdminService::ListRevisions(grpc::ServerContext* /*context*/,
                                             const v1::ListRevisionsRequest* /*request*/,
                                             v1::ListRevisionsResponse* response) {
  *response = revisions;
  return grpc::Status::OK;
}

grpc::Status FakeAdminService::DetectChanges(grpc::ServerContext* /*context*/, const v1::DetectChangesRequest* request,
                                             grpc::ServerWriter<v1::DetectChangesResponse>* writer) {
  if (const grpc::Status status = Check(request->name()); !status.ok()) return status;
  detect_requests.push_back(*request);
  v1::DetectChangesResponse progress;
  progress.mutable_progress()->set_num_sessions(3);
  writer->Write(progress);
  v1::DetectChangesResponse result;
  *result.mutable_result() = detection;
  writer->Write(result);
  return grpc::Status::OK;
}

grpc::Status FakeAdminService::ListChanges(grpc::ServerContext* /*context*/, const v1::ListChangesRequest* request,
                                           v1::ListChangesResponse* response) {
  if (const grpc::Status status = Check(request->name()); !status.ok()) return status;
  response->mutable_changes()->Add(changes.begin(), changes.end());
  return grpc::Status::OK;
}

template <typename Request>
grpc::Status FakeAdminService::Decide(const std::string& what, const Request& request,
                                      v1::DecideChangesResponse& response) {
  if (const grpc::Status status = Check(request.name()); !status.ok()) return status;
  decisions.push_back(fmt::format("{} {}", what, fmt::join(request.ids(), " ")));
  response = decision;
  return decision_status;
}

grpc::Status FakeAdminService::AcceptChanges(grpc::ServerContext* /*context*/, const v1::AcceptChangesRequest* request,
                                             v1::DecideChangesResponse* response) {
  return Decide("accept", *request, *response);
}

grpc::Status FakeAdminService::RejectChanges(grpc::ServerContext* /*context*/, const v1::RejectChangesRequest* request,
                                             v1::DecideChangesResponse* response) {
  return Decide("reject", *request, *response);
}

grpc::Status FakeAdminService::UndoChanges(grpc::ServerContext* /*context*/, const v1::UndoChangesRequest* request,
                                           v1::DecideChangesResponse* response) {
  return Decide("undo", *request, *response);
}

}  // namespace mapp
