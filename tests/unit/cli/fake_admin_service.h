#pragma once

#include "mapp/v1/admin_service.grpc.pb.h"

#include <grpcpp/server.h>

#include <map>
#include <memory>
#include <string>
#include <vector>

namespace mapp {

/// An admin server with one map whose state a test sets, on a loopback port of its own: what `mapp changes` asks for.
/// The state is set before the first call; requests are read after the last.
class FakeAdminService final : public v1::AdminService::Service {
 public:
  FakeAdminService();
  ~FakeAdminService() override;

  std::string address() const;

  v1::ExportMapResponse now;                        ///< the map
  std::map<std::string, v1::ExportMapResponse> at;  ///< its past; revisions that are not there are compacted away
  std::vector<v1::Change> changes;
  v1::DetectChangesResponse::Result detection;
  v1::DecideChangesResponse decision;
  v1::ListRevisionsResponse revisions;
  grpc::Status decision_status;

  std::vector<v1::DetectChangesRequest> detect_requests;
  std::vector<std::string> decisions;        ///< "accept 1 2"
  std::vector<std::string> export_requests;  ///< `at` of each

  grpc::Status ExportMap(grpc::ServerContext* context, const v1::ExportMapRequest* request,
                         grpc::ServerWriter<v1::ExportMapResponse>* writer) override;
  grpc::Status ListRevisions(grpc::ServerContext* context, const v1::ListRevisionsRequest* request,
                             v1::ListRevisionsResponse* response) override;
  grpc::Status DetectChanges(grpc::ServerContext* context, const v1::DetectChangesRequest* request,
                             grpc::ServerWriter<v1::DetectChangesResponse>* writer) override;
  grpc::Status ListChanges(grpc::ServerContext* context, const v1::ListChangesRequest* request,
                           v1::ListChangesResponse* response) override;
  grpc::Status AcceptChanges(grpc::ServerContext* context, const v1::AcceptChangesRequest* request,
                             v1::DecideChangesResponse* response) override;
  grpc::Status RejectChanges(grpc::ServerContext* context, const v1::RejectChangesRequest* request,
                             v1::DecideChangesResponse* response) override;
  grpc::Status UndoChanges(grpc::ServerContext* context, const v1::UndoChangesRequest* request,
                           v1::DecideChangesResponse* response) override;

 private:
  template <typename Request>
  grpc::Status Decide(const std::string& what, const Request& request, v1::DecideChangesResponse& response);
  /// NOT_FOUND but for the map that is there.
  grpc::Status Check(const std::string& map_name) const;

  int port_ = 0;
  std::unique_ptr<grpc::Server> server_;
};

}  // namespace mapp
