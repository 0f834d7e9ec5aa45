#pragma once

#include "mapp/base/mutex.h"
#include "mapp/map/keyframe.h"
#include "mapp/map/tile.h"
#include "mapp/v1/map_service.grpc.pb.h"

#include <grpcpp/server.h>

#include <deque>
#include <functional>
#include <map>
#include <memory>
#include <string>
#include <vector>

namespace mapp {

/// A server whose answers a test sets, on a loopback port of its own. Thread-safe.
class FakeMapService final : public v1::MapService::Service {
 public:
  /// What the server answers from now on.
  struct Script {
    /// Sent with every upload's answer; none while the session is to stay unaligned.
    std::optional<Pose3> T_map_session;
    /// Every sample's state in answers to queries, and whether every bin is occupied.
    bool samples_redundant = false;
    bool is_own_map = false;  ///< then no tile is sent
    std::vector<Tile> tiles;
    uint32_t num_tiles_over_budget = 0;  ///< as told in the summary
    int64_t map_created_ns = 1000;
    v1::UpdateVerdict verdict = v1::UPDATE_VERDICT_NONE;
    bool optimization_pending = false;
    /// Where the map has every upload, in front of the pose it came with.
    std::optional<Pose3> T_corrected_sent;
    /// Statuses of the next calls of a method, in order; without one left the call succeeds.
    std::deque<grpc::StatusCode> open_errors;
    std::deque<grpc::StatusCode> close_errors;
    std::deque<grpc::StatusCode> upload_errors;
    std::deque<grpc::StatusCode> query_errors;
    std::deque<grpc::StatusCode> shared_map_errors;
    std::deque<grpc::StatusCode> evidence_errors;
    bool unchanged_held_beyond = false;  ///< answers speak of a held tile that there is none of
    bool hold_after_first_tile = false;  ///< shared maps wait there until this is false again
    bool hold_shared_maps = false;       ///< requests for them wait until this is false again
  };

  static constexpr uint32_t kSession = 7;  ///< the first that is opened; those that follow count on

  FakeMapService();
  ~FakeMapService() override;

  std::string address() const;
  void Change(const std::function<void(Script&)>& change);
  /// To a session's watcher, now or once it listens.
  void Send(const v1::WatchSessionResponse& event, uint32_t session = kSession);
  /// Ends the watcher's stream; it may come back.
  void BreakWatch();
  /// Stops answering, as a killed server does.
  void Stop();

  std::vector<Keyframe> uploads() const;  ///< stored, in order
  std::vector<v1::AssessOverlapRequest> queries() const;
  std::vector<v1::RequestSharedMapRequest> shared_map_requests() const;
  std::vector<Keyframe> reported() const;
  std::vector<v1::ReportEvidenceRequest> evidence() const;  ///< stored, in order
  int num_evidence_attempts() const;
  int num_upload_attempts() const;
  int num_open_attempts() const;
  std::vector<v1::OpenSessionRequest> opened() const;
  int num_closes() const;
  std::vector<uint32_t> closed_sessions() const;  ///< in order, each once
  int num_watches() const;

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
  grpc::Status WatchSession(grpc::ServerContext* context, const v1::WatchSessionRequest* request,
                            grpc::ServerWriter<v1::WatchSessionResponse>* writer) override;

 private:
  mutable Mutex mutex_;
  CondVar changed_;
  Script script_ ABSL_GUARDED_BY(mutex_);
  std::vector<Keyframe> uploads_ ABSL_GUARDED_BY(mutex_);
  std::vector<v1::OpenSessionRequest> opened_ ABSL_GUARDED_BY(mutex_);
  std::vector<v1::AssessOverlapRequest> queries_ ABSL_GUARDED_BY(mutex_);
  std::vector<v1::RequestSharedMapRequest> shared_map_requests_ ABSL_GUARDED_BY(mutex_);
  std::vector<Keyframe> reported_ ABSL_GUARDED_BY(mutex_);
  std::vector<v1::ReportEvidenceRequest> evidence_ ABSL_GUARDED_BY(mutex_);
  int num_evidence_attempts_ ABSL_GUARDED_BY(mutex_) = 0;
  std::map<uint32_t, std::deque<v1::WatchSessionResponse>> events_ ABSL_GUARDED_BY(mutex_);  // by session
  std::vector<uint32_t> closed_sessions_ ABSL_GUARDED_BY(mutex_);
  uint32_t next_session_ ABSL_GUARDED_BY(mutex_) = kSession;
  int num_open_attempts_ ABSL_GUARDED_BY(mutex_) = 0;
  int num_upload_attempts_ ABSL_GUARDED_BY(mutex_) = 0;
  int num_closes_ ABSL_GUARDED_BY(mutex_) = 0;
  int num_watches_ ABSL_GUARDED_BY(mutex_) = 0;
  int watches_to_break_ ABSL_GUARDED_BY(mutex_) = 0;
  bool stopping_ ABSL_GUARDED_BY(mutex_) = false;
  int port_ = 0;
  std::unique_ptr<grpc::Server> server_;
};

v1::WatchSessionResponse AlignedMessage(const Pose3& T_map_session, uint32_t keyframe);
v1::WatchSessionResponse TriedMessage(uint32_t keyframe);

}  // namespace mapp
