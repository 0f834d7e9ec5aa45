#pragma once

#include "mapp/v1/map_service.grpc.pb.h"
#include "server/rpc/call_runner.h"
#include "server/rpc/watchers.h"
#include "server/service/map_service.h"

namespace mapp {

/// The gRPC face of MapService: each call decodes and validates, calls the service, encodes. One .cc per call.
/// WatchSession runs on gRPC's callback interface, so that a watcher holds no thread; the others are synchronous.
class MapServiceHandler final : public v1::MapService::WithCallbackMethod_WatchSession<v1::MapService::Service> {
 public:
  /// All must outlive the handler.
  MapServiceHandler(MapService& service, CallRunner& runner, Watchers& watchers, uint32_t max_keyframe_bytes)
      : service_(service), runner_(runner), watchers_(watchers), max_keyframe_bytes_(max_keyframe_bytes) {}

  grpc::Status OpenSession(grpc::ServerContext* context, const v1::OpenSessionRequest* request,
                           v1::OpenSessionResponse* response) override;
  grpc::Status AssessOverlap(grpc::ServerContext* context, const v1::AssessOverlapRequest* request,
                             v1::AssessOverlapResponse* response) override;
  grpc::Status UploadPartialKeyframe(grpc::ServerContext* context, const v1::UploadPartialKeyframeRequest* request,
                                     v1::UploadPartialKeyframeResponse* response) override;
  grpc::Status RequestSharedMap(grpc::ServerContext* context, const v1::RequestSharedMapRequest* request,
                                grpc::ServerWriter<v1::RequestSharedMapResponse>* writer) override;
  grpc::Status ReportUpdate(grpc::ServerContext* context, const v1::ReportUpdateRequest* request,
                            v1::ReportUpdateResponse* response) override;
  grpc::Status ReportEvidence(grpc::ServerContext* context, const v1::ReportEvidenceRequest* request,
                              v1::ReportEvidenceResponse* response) override;
  grpc::Status CloseSession(grpc::ServerContext* context, const v1::CloseSessionRequest* request,
                            v1::CloseSessionResponse* response) override;
  grpc::Status GetSessionPoses(grpc::ServerContext* context, const v1::GetSessionPosesRequest* request,
                               v1::GetSessionPosesResponse* response) override;
  grpc::ServerWriteReactor<v1::WatchSessionResponse>* WatchSession(grpc::CallbackServerContext* context,
                                                                   const v1::WatchSessionRequest* request) override;

 private:
  MapService& service_;
  CallRunner& runner_;
  Watchers& watchers_;
  const uint32_t max_keyframe_bytes_;
};

}  // namespace mapp
