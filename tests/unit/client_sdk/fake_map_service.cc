#include "fake_map_service.h"

#include "api/convert/convert.h"
#include "mapp/base/bytes.h"
#include "mapp/codec/keyframe_codec.h"
#include "mapp/codec/query_codec.h"
#include "mapp/codec/tile_codec.h"

#include <fmt/format.h>
#include <grpcpp/server_builder.h>

#include <algorithm>

namespace mapp {
namespace {

grpc::Status Next(std::deque<grpc::StatusCode>& errors) {
  if (errors.empty()) return grpc::Status::OK;
  const grpc::StatusCode code = errors.front();
  errors.pop_front();
  return {code, "as the test wants it"};
}

/// All samples in one state, or all bins.
OverlapAnswer Answer(const ViewQuery& view, size_t num_samples, bool redundant) {
  if (view.sampler != SamplerKind::kOccupancy) return SampleStates{std::vector<bool>(num_samples, redundant)};
  OccupancyGrid grid(view.sketch, {});
  for (int row = 0; row < grid.rows() && redundant; ++row) {
    for (int column = 0; column < grid.columns(); ++column) {
      const OccupancyGrid::DepthRange depths = grid.DepthsOf(column, row);
      for (int i = 0; i < depths.count; ++i) grid.Occupy(column, row, depths.first + i);
    }
  }
  return grid;
}

}  // namespace

FakeMapService::FakeMapService() {
  grpc::ServerBuilder builder;
  builder.AddListeningPort("127.0.0.1:0", grpc::InsecureServerCredentials(), &port_);
  builder.RegisterService(this);
  server_ = builder.BuildAndStart();
}

FakeMapService::~FakeMapService() { Stop(); }

std::string FakeMapService::address() const { return fmt::format("127.0.0.1:{}", port_); }

void FakeMapService::Stop() {
  {
    MutexLock lock(mutex_);
    stopping_ = true;
    changed_.NotifyAll();
  }
  server_->Shutdown(std::chrono::system_clock::now());
  server_->Wait();
}

void FakeMapService::Change(const std::function<void(Script&)>& change) {
  MutexLock lock(mutex_);
  change(script_);
  changed_.NotifyAll();
}

void FakeMapService::Send(const v1::WatchSessionResponse& event, uint32_t session) {
  MutexLock lock(mutex_);
  events_[session].push_back(event);
  changed_.NotifyAll();
}

void FakeMapService::BreakWatch() {
  MutexLock lock(mutex_);
  ++watches_to_break_;
  changed_.NotifyAll();
}

std::vector<Keyframe> FakeMapService::uploads() const {
  MutexLock lock(mutex_);
  return uploads_;
}
std::vector<v1::AssessOverlapRequest> FakeMapService::queries() const {
  MutexLock lock(mutex_);
  return queries_;
}
std::vector<v1::RequestSharedMapRequest> FakeMapService::shared_map_requests() const {
  MutexLock lock(mutex_);
  return shared_map_requests_;
}
std::vector<Keyframe> FakeMapService::reported() const {
  MutexLock lock(mutex_);
  return reported_;
}

std::vector<v1::ReportEvidenceRequest> FakeMapService::evidence() const {
  MutexLock lock(mutex_);
  return evidence_;
}

int FakeMapService::num_evidence_attempts() const {
  MutexLock lock(mutex_);
  return num_evidence_attempts_;
}
int FakeMapService::num_upload_attempts() const {
  MutexLock lock(mutex_);
  return num_upload_attempts_;
}
int FakeMapService::num_open_attempts() const {
  MutexLock lock(mutex_);
  return num_open_attempts_;
}
std::vector<uint32_t> FakeMapService::closed_sessions() const {
  MutexLock lock(mutex_);
  return closed_sessions_;
}
std::vector<v1::OpenSessionRequest> FakeMapService::opened() const {
  MutexLock lock(mutex_);
  return opened_;
}
int FakeMapService::num_closes() const {
  MutexLock lock(mutex_);
  return num_closes_;
}
int FakeMapService::num_watches() const {
  MutexLock lock(mutex_);
  return num_watches_;
}

grpc::Status FakeMapService::OpenSession(grpc::ServerContext*, const v1::OpenSessionRequest* request,
                                         v1::OpenSessionResponse* response) {
  MutexLock lock(mutex_);
  ++num_open_attempts_;
  if (const grpc::Status status = Next(script_.open_errors); !status.ok()) return status;
  opened_.push_back(*request);
  response->set_session_id(next_session_++);
  response->set_map_id(1);
  response->set_map_created_unix_ns(script_.map_created_ns);
  response->set_cone_range_m(20);
  response->set_tile_edge_m(kDefaultTileEdgeM);
  response->set_max_keyframe_bytes(64 << 10);
  return grpc::Status::OK;
}

grpc::Status FakeMapService::AssessOverlap(grpc::ServerContext*, const v1::AssessOverlapRequest* request,
                                           v1::AssessOverlapResponse* response) {
  MutexLock lock(mutex_);
  if (const grpc::Status status = Next(script_.query_errors); !status.ok()) return status;
  queries_.push_back(*request);
  const StatusOr<ViewQuery> view = DecodeViewQuery(request->view());
  if (!view.ok()) return {grpc::StatusCode::INVALID_ARGUMENT, std::string(view.status().message())};
  response->set_answer(EncodeOverlapAnswer(Answer(*view, request->num_samples(), script_.samples_redundant)));
  return grpc::Status::OK;
}

grpc::Status FakeMapService::UploadPartialKeyframe(grpc::ServerContext*,
                                                   const v1::UploadPartialKeyframeRequest* request,
                                                   v1::UploadPartialKeyframeResponse* response) {
  MutexLock lock(mutex_);
  ++num_upload_attempts_;
  if (const grpc::Status status = Next(script_.upload_errors); !status.ok()) return status;
  const StatusOr<Keyframe> keyframe = DecodeKeyframe(request->keyframe());
  if (!keyframe.ok()) return {grpc::StatusCode::INVALID_ARGUMENT, "keyframe: does not decode"};
  const auto same = [&](const Keyframe& stored) {
    return stored.session == keyframe->session && stored.number == keyframe->number;
  };
  response->set_already_stored(std::any_of(uploads_.begin(), uploads_.end(), same));
  if (!response->already_stored()) uploads_.push_back(*keyframe);
  if (script_.T_map_session) *response->mutable_pose_map_session() = ToProto(*script_.T_map_session);
  return grpc::Status::OK;
}

grpc::Status FakeMapService::RequestSharedMap(grpc::ServerContext*, const v1::RequestSharedMapRequest* request,
                                              grpc::ServerWriter<v1::RequestSharedMapResponse>* writer) {
  std::vector<Tile> tiles;
  v1::SharedMapSummary summary;
  {
    MutexLock lock(mutex_);
    shared_map_requests_.push_back(*request);
    while (script_.hold_shared_maps && !stopping_) changed_.Wait(mutex_);
    if (const grpc::Status status = Next(script_.shared_map_errors); !status.ok()) return status;
    if (!script_.is_own_map) tiles = script_.tiles;
    summary.set_is_own_map(script_.is_own_map);
    summary.set_num_tiles_over_budget(script_.num_tiles_over_budget);
    if (script_.unchanged_held_beyond)
      summary.add_unchanged_held_tiles(static_cast<uint32_t>(request->held_tiles_size()));
  }
  v1::RequestSharedMapResponse message;
  std::vector<bool> is_settled(static_cast<size_t>(request->held_tiles_size()), false);
  for (const Tile& tile : tiles) {
    const std::string bytes = EncodeTile(tile);
    const auto held = std::find_if(request->held_tiles().begin(), request->held_tiles().end(),
                                   [&](const v1::HeldTile& h) { return h.key() == tile.key.Packed(); });
    const auto held_idx = static_cast<size_t>(held - request->held_tiles().begin());
    if (held != request->held_tiles().end()) is_settled[held_idx] = true;
    if (held != request->held_tiles().end() && held->crc32c() == Crc32c(bytes)) {
      summary.add_unchanged_held_tiles(static_cast<uint32_t>(held_idx));
      continue;
    }
    message.set_tile(bytes);
    writer->Write(message);
    MutexLock lock(mutex_);
    while (script_.hold_after_first_tile && !stopping_) changed_.Wait(mutex_);
  }
  for (size_t i = 0; i < is_settled.size() && !summary.is_own_map(); ++i) {
    if (!is_settled[i]) summary.add_outdated_held_tiles(static_cast<uint32_t>(i));
  }
  message.Clear();
  *message.mutable_summary() = summary;
  writer->Write(message);
  return grpc::Status::OK;
}

grpc::Status FakeMapService::ReportUpdate(grpc::ServerContext*, const v1::ReportUpdateRequest* request,
                                          v1::ReportUpdateResponse* response) {
  MutexLock lock(mutex_);
  for (const std::string& packet : request->keyframes()) {
    const StatusOr<Keyframe> keyframe = DecodeKeyframe(packet);
    if (!keyframe.ok()) return {grpc::StatusCode::INVALID_ARGUMENT, "keyframes: one does not decode"};
    reported_.push_back(*keyframe);
  }
  response->set_verdict(script_.verdict);
  return grpc::Status::OK;
}

grpc::Status FakeMapService::ReportEvidence(grpc::ServerContext*, const v1::ReportEvidenceRequest* request,
                                            v1::ReportEvidenceResponse* response) {
  MutexLock lock(mutex_);
  ++num_evidence_attempts_;
  if (const grpc::Status status = Next(script_.evidence_errors); !status.ok()) return status;
  response->set_already_stored(std::ranges::any_of(evidence_, [&](const v1::ReportEvidenceRequest& stored) {
    return stored.session_id() == request->session_id() && stored.number() == request->number();
  }));
  if (!response->already_stored()) evidence_.push_back(*request);
  return grpc::Status::OK;
}

grpc::Status FakeMapService::CloseSession(grpc::ServerContext*, const v1::CloseSessionRequest* request,
                                          v1::CloseSessionResponse* response) {
  MutexLock lock(mutex_);
  ++num_closes_;
  if (const grpc::Status status = Next(script_.close_errors); !status.ok()) return status;
  const uint32_t session = request->session_id();
  if (std::ranges::count(closed_sessions_, session) == 0) closed_sessions_.push_back(session);
  response->set_num_keyframes(uploads_.size());
  response->set_optimization_pending(script_.optimization_pending);
  return grpc::Status::OK;
}

grpc::Status FakeMapService::GetSessionPoses(grpc::ServerContext*, const v1::GetSessionPosesRequest* request,
                                             v1::GetSessionPosesResponse* response) {
  MutexLock lock(mutex_);
  if (!script_.T_corrected_sent) return {grpc::StatusCode::FAILED_PRECONDITION, "not aligned"};
  for (const Keyframe& upload : uploads_) {
    if (upload.session.value() != request->session_id()) continue;
    v1::GetSessionPosesResponse::KeyframePose& keyframe = *response->add_keyframes();
    keyframe.set_keyframe(upload.number);
    keyframe.set_stamp_ns(upload.stamp_ns);
    *keyframe.mutable_pose_map_camera() = ToProto(*script_.T_corrected_sent * upload.T_frame_camera);
  }
  return grpc::Status::OK;
}

grpc::Status FakeMapService::WatchSession(grpc::ServerContext* context, const v1::WatchSessionRequest* request,
                                          grpc::ServerWriter<v1::WatchSessionResponse>* writer) {
  {
    MutexLock lock(mutex_);
    ++num_watches_;
  }
  v1::WatchSessionResponse started;
  started.mutable_started();
  writer->Write(started);
  mutex_.Lock();
  while (!stopping_ && watches_to_break_ == 0 && !context->IsCancelled()) {
    std::deque<v1::WatchSessionResponse>& events = events_[request->session_id()];
    if (events.empty()) {
      // A cancelled call notifies nobody: look again now and then.
      changed_.WaitUntil(mutex_, std::chrono::steady_clock::now() + std::chrono::milliseconds(20));
      continue;
    }
    const v1::WatchSessionResponse event = events.front();
    events.pop_front();
    mutex_.Unlock();
    writer->Write(event);
    mutex_.Lock();
  }
  if (watches_to_break_ > 0) --watches_to_break_;
  mutex_.Unlock();
  return {grpc::StatusCode::UNAVAILABLE, "the watch is over"};
}

v1::WatchSessionResponse AlignedMessage(const Pose3& T_map_session, uint32_t keyframe) {
  v1::WatchSessionResponse message;
  *message.mutable_aligned()->mutable_pose_map_session() = ToProto(T_map_session);
  message.mutable_aligned()->set_keyframe(keyframe);
  return message;
}

v1::WatchSessionResponse TriedMessage(uint32_t keyframe) {
  v1::WatchSessionResponse message;
  message.mutable_alignment_tried()->set_keyframe(keyframe);
  return message;
}

}  // namespace mapp
