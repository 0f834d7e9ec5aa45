#include "api/convert/convert.h"
#include "api/status/grpc_status.h"
#include "server/rpc/map_service_handler.h"

#include <deque>
#include <string>

namespace mapp {
namespace {

/// Messages that may wait for a slow reader; beyond it the stream ends and the client, when it comes back, starts from
/// the present alignment.
constexpr size_t kMaxQueued = 1024;

struct ToEvent {
  v1::WatchSessionResponse& response;

  void operator()(const AlignmentTried& event) const {
    auto& out = *response.mutable_alignment_tried();
    out.set_keyframe(event.keyframe);
    out.set_num_candidates(event.num_candidates);
    out.set_num_inliers(event.num_inliers);
    out.set_num_consistent(event.num_consistent);
  }
  void operator()(const SessionAligned& event) const {
    *response.mutable_aligned()->mutable_pose_map_session() = ToProto(event.T_map_session);
    response.mutable_aligned()->set_keyframe(event.keyframe);
    response.mutable_aligned()->set_scale_map_session(event.scale_map_session);
  }
  void operator()(const SessionCorrected& event) const {
    *response.mutable_corrected()->mutable_pose_map_session() = ToProto(event.T_map_session);
    response.mutable_corrected()->set_scale_map_session(event.scale_map_session);
  }
  void operator()(const TilesChanged& event) const {
    auto& out = *response.mutable_tiles_changed();
    for (const TileKey& key : event.keys) out.add_keys(key.Packed());
    out.set_map_revision(event.revision.value());
  }
  void operator()(const OptimizationFinished& event) const {
    auto& out = *response.mutable_optimized();
    out.set_applied(event.applied);
    out.set_initial_rmse_px(event.initial_rmse_px);
    out.set_final_rmse_px(event.final_rmse_px);
    out.set_num_frames(event.num_frames);
    out.set_num_points(event.num_points);
    out.set_seconds(event.seconds);
  }
  void operator()(const SessionQuarantined& event) const { response.mutable_quarantined()->set_reason(event.reason); }
  void operator()(const SessionReleased&) const { response.mutable_released(); }
};

/// One stream. Events are queued by the threads that publish them and written one at a time; deletes itself when the
/// call is over. No lock is held while gRPC or the service is called.
class WatchReactor final : public grpc::ServerWriteReactor<v1::WatchSessionResponse>, public Watcher {
 public:
  WatchReactor(grpc::CallbackServerContext& context, uint64_t bytes_in, MapService& service, CallRunner& runner,
               Watchers& watchers, StatusOr<SessionId> session)
      : context_(context),
        bytes_in_(bytes_in),
        runner_(runner),
        watchers_(watchers),
        request_id_(runner.RequestId(context)),
        peer_(context.peer()),
        begin_(std::chrono::steady_clock::now()) {
    if (const Status status = Start(service, session); !status.ok()) End(status);
  }

  void End(const Status& status) override {
    {
      MutexLock lock(mutex_);
      if (ending_) return;
      ending_ = true;
      status_ = status;
      if (writing_) return;  // OnWriteDone finishes
    }
    FinishCall();
  }

  void OnWriteDone(bool ok) override {
    if (!ok) End(absl::CancelledError("the caller is gone"));
    bool has_next = false;
    bool is_over = false;
    {
      // Decided at once: when nothing is being written any more, Push may begin to write from another thread, and gRPC
      // ends the process when two writes are under way.
      MutexLock lock(mutex_);
      bytes_out_ += current_.ByteSizeLong();
      has_next = !queue_.empty() && ok;
      if (has_next) {
        current_ = std::move(queue_.front());
        queue_.pop_front();
      } else {
        writing_ = false;
        is_over = ending_;
      }
    }
    if (has_next) StartWrite(&current_);
    if (is_over) FinishCall();
  }

  void OnCancel() override { End(absl::CancelledError("the caller is gone")); }

  void OnDone() override {
    // Both wait for a call that may be under way into this object; after them nobody refers to it.
    subscription_.reset();
    watchers_.Remove(this);
    runner_.Finished("WatchSession", status_, request_id_, peer_, begin_, bytes_in_, bytes_out_);
    delete this;
  }

 private:
  Status Start(MapService& service, const StatusOr<SessionId>& session) {
    MAPP_RETURN_IF_ERROR(session.status());
    MAPP_RETURN_IF_ERROR(watchers_.Add(this));
    CallContext call;
    call.request_id = request_id_;
    const auto on_event = [this](const SessionEvent& event) {
      v1::WatchSessionResponse response;
      std::visit(ToEvent{response}, event);
      Push(std::move(response));
    };
    MAPP_ASSIGN_OR_RETURN(subscription_, service.WatchSession(call, *session, on_event));
    v1::WatchSessionResponse started;
    started.mutable_started();
    Push(std::move(started));
    return absl::OkStatus();
  }

  void Push(v1::WatchSessionResponse response) {
    bool overflow = false;
    {
      MutexLock lock(mutex_);
      if (ending_) return;
      overflow = queue_.size() >= kMaxQueued;
      if (!overflow && writing_) {
        queue_.push_back(std::move(response));
        return;
      }
      if (!overflow) {
        writing_ = true;
        current_ = std::move(response);
      }
    }
    if (overflow) {
      End(absl::ResourceExhaustedError("the watcher reads too slowly"));
    } else {
      StartWrite(&current_);
    }
  }

  void FinishCall() {
    {
      MutexLock lock(mutex_);
      if (finished_) return;
      finished_ = true;
    }
    AttachErrorDetail(status_, context_);
    Finish(ToGrpcStatus(status_));
  }

  grpc::CallbackServerContext& context_;
  const uint64_t bytes_in_;
  CallRunner& runner_;
  Watchers& watchers_;
  const std::string request_id_;
  const std::string peer_;
  const std::chrono::steady_clock::time_point begin_;
  std::unique_ptr<SessionEvents::Subscription> subscription_;

  Mutex mutex_;
  std::deque<v1::WatchSessionResponse> queue_ ABSL_GUARDED_BY(mutex_);
  bool writing_ ABSL_GUARDED_BY(mutex_) = false;
  bool ending_ ABSL_GUARDED_BY(mutex_) = false;
  bool finished_ ABSL_GUARDED_BY(mutex_) = false;
  uint64_t bytes_out_ = 0;
  Status status_;                     // set once, before the call is finished
  v1::WatchSessionResponse current_;  // the message being written, while writing_
};

}  // namespace

grpc::ServerWriteReactor<v1::WatchSessionResponse>* MapServiceHandler::WatchSession(
    grpc::CallbackServerContext* context, const v1::WatchSessionRequest* request) {
  return new WatchReactor(*context, request->ByteSizeLong(), service_, runner_, watchers_,
                          SessionIdFromProto(request->session_id(), "session_id"));
}

}  // namespace mapp
