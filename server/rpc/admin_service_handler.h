#pragma once

#include "mapp/v1/admin_service.grpc.pb.h"
#include "server/rpc/call_runner.h"
#include "server/service/map_service.h"
#include "storage/sqlite/backup.h"
#include "storage/verify.h"

#include <atomic>
#include <functional>
#include <string>
#include <utility>

namespace mapp {

/// What GetServerInfo tells besides the calls' figures.
struct ServerFacts {
  std::string version;
  uint32_t schema_version = 0;
  int64_t started_unix_ns = 0;
};

/// BackUpDatabase of the server's database, to a file or folder on this machine.
using BackUpFunction = std::function<StatusOr<Backup>(const CallContext&, const BackupOptions&)>;

/// VerifyDatabase of the server's database.
using VerifyFunction = std::function<StatusOr<VerifyReport>(
    const CallContext&, const std::function<void(const VerifyProgress&)>& on_progress)>;

/// The gRPC face of what operators ask of MapService and of the database file.
class AdminServiceHandler final : public v1::AdminService::Service {
 public:
  /// Service and runner must outlive the handler. Without `back_up` BackUp is refused, without `verify` VerifyDatabase.
  /// `spool_folder` takes bundles while they arrive.
  AdminServiceHandler(MapService& service, CallRunner& runner, const ServerFacts& facts, BackUpFunction back_up,
                      VerifyFunction verify, std::string spool_folder)
      : service_(service),
        runner_(runner),
        facts_(facts),
        back_up_(std::move(back_up)),
        verify_(std::move(verify)),
        spool_folder_(std::move(spool_folder)) {}

  grpc::Status GetServerInfo(grpc::ServerContext* context, const v1::GetServerInfoRequest* request,
                             v1::GetServerInfoResponse* response) override;
  grpc::Status ListMaps(grpc::ServerContext* context, const v1::ListMapsRequest* request,
                        v1::ListMapsResponse* response) override;
  grpc::Status GetMap(grpc::ServerContext* context, const v1::GetMapRequest* request,
                      v1::GetMapResponse* response) override;
  grpc::Status DeleteMap(grpc::ServerContext* context, const v1::DeleteMapRequest* request,
                         v1::DeleteMapResponse* response) override;
  grpc::Status ListSessions(grpc::ServerContext* context, const v1::ListSessionsRequest* request,
                            v1::ListSessionsResponse* response) override;
  grpc::Status RevertSession(grpc::ServerContext* context, const v1::RevertSessionRequest* request,
                             v1::RevertSessionResponse* response) override;
  grpc::Status EraseSession(grpc::ServerContext* context, const v1::EraseSessionRequest* request,
                            v1::EraseSessionResponse* response) override;
  grpc::Status ReleaseSession(grpc::ServerContext* context, const v1::ReleaseSessionRequest* request,
                              v1::ReleaseSessionResponse* response) override;
  grpc::Status ExportMap(grpc::ServerContext* context, const v1::ExportMapRequest* request,
                         grpc::ServerWriter<v1::ExportMapResponse>* writer) override;
  grpc::Status OptimizeMap(grpc::ServerContext* context, const v1::OptimizeMapRequest* request,
                           grpc::ServerWriter<v1::OptimizeMapResponse>* writer) override;
  grpc::Status BackUp(grpc::ServerContext* context, const v1::BackUpRequest* request,
                      grpc::ServerWriter<v1::BackUpResponse>* writer) override;
  grpc::Status VerifyDatabase(grpc::ServerContext* context, const v1::VerifyDatabaseRequest* request,
                              grpc::ServerWriter<v1::VerifyDatabaseResponse>* writer) override;
  grpc::Status ListRevisions(grpc::ServerContext* context, const v1::ListRevisionsRequest* request,
                             v1::ListRevisionsResponse* response) override;
  grpc::Status DiffRevisions(grpc::ServerContext* context, const v1::DiffRevisionsRequest* request,
                             v1::DiffRevisionsResponse* response) override;
  grpc::Status ListTags(grpc::ServerContext* context, const v1::ListTagsRequest* request,
                        v1::ListTagsResponse* response) override;
  grpc::Status PutTag(grpc::ServerContext* context, const v1::PutTagRequest* request,
                      v1::PutTagResponse* response) override;
  grpc::Status DeleteTag(grpc::ServerContext* context, const v1::DeleteTagRequest* request,
                         v1::DeleteTagResponse* response) override;
  grpc::Status CompactMap(grpc::ServerContext* context, const v1::CompactMapRequest* request,
                          grpc::ServerWriter<v1::CompactMapResponse>* writer) override;
  grpc::Status ExportBundle(grpc::ServerContext* context, const v1::ExportBundleRequest* request,
                            grpc::ServerWriter<v1::ExportBundleResponse>* writer) override;
  grpc::Status ImportBundle(
      grpc::ServerContext* context,
      grpc::ServerReaderWriter<v1::ImportBundleResponse, v1::ImportBundleRequest>* stream) override;
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
  MapService& service_;
  CallRunner& runner_;
  const ServerFacts facts_;
  const BackUpFunction back_up_;
  const VerifyFunction verify_;
  const std::string spool_folder_;
  std::atomic<bool> verifying_ = false;
};

}  // namespace mapp
