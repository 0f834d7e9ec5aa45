#include "watch_thread.h"

#include "api/convert/convert.h"
#include "api/status/grpc_status.h"

#include <optional>

namespace mapp {
namespace {

StatusOr<Pose3> AlignmentOf(const v1::Pose& pose) { return FromProto(pose, "pose_map_session"); }

/// nullopt for an event that this version does not know. An event that does not decode is an error.
StatusOr<std::optional<ClientEvent>> ToClientEvent(const v1::WatchSessionResponse& response) {
  switch (response.event_case()) {
    case v1::WatchSessionResponse::kAlignmentTried: {
      const auto& tried = response.alignment_tried();
      return AlignmentTriedEvent{.keyframe = tried.keyframe(),
                                 .num_candidates = tried.num_candidates(),
                                 .num_inliers = tried.num_inliers(),
                                 .num_consistent = tried.num_consistent()};
    }
    case v1::WatchSessionResponse::kAligned: {
      MAPP_ASSIGN_OR_RETURN(const Pose3 T_map_session, AlignmentOf(response.aligned().pose_map_session()));
      MAPP_ASSIGN_OR_RETURN(const double scale,
                            ScaleFromProto(response.aligned().scale_map_session(), "scale_map_session"));
      return AlignedEvent{
          .T_map_session = T_map_session, .keyframe = response.aligned().keyframe(), .scale_map_session = scale};
    }
    case v1::WatchSessionResponse::kCorrected: {
      MAPP_ASSIGN_OR_RETURN(const Pose3 T_map_session, AlignmentOf(response.corrected().pose_map_session()));
      MAPP_ASSIGN_OR_RETURN(const double scale,
                            ScaleFromProto(response.corrected().scale_map_session(), "scale_map_session"));
      return CorrectedEvent{.T_map_session = T_map_session, .scale_map_session = scale};
    }
    case v1::WatchSessionResponse::kTilesChanged: {
      TilesChangedEvent event;
      event.revision = Revision(response.tiles_changed().map_revision());
      for (const uint64_t packed : response.tiles_changed().keys()) {
        MAPP_ASSIGN_OR_RETURN(const TileKey key, TileKeyFromProto(packed, "tiles_changed.keys"));
        event.keys.push_back(key);
      }
      return event;
    }
    case v1::WatchSessionResponse::kOptimized: {
      const auto& optimized = response.optimized();
      return OptimizedEvent{.applied = optimized.applied(),
                            .initial_rmse_px = optimized.initial_rmse_px(),
                            .final_rmse_px = optimized.final_rmse_px()};
    }
    case v1::WatchSessionResponse::kQuarantined:
      return QuarantinedEvent{.reason = response.quarantined().reason()};
    case v1::WatchSessionResponse::kReleased:
      return ReleasedEvent{};
    case v1::WatchSessionResponse::kStarted:
      return WatchStartedEvent{};
    case v1::WatchSessionResponse::EVENT_NOT_SET:
      return std::nullopt;
  }
  return std::nullopt;
}

/// A later attempt may fare better. RESOURCE_EXHAUSTED is what a watcher that read too slowly gets.
bool MayComeBack(const Status& status) {
  return status.ok() || absl::IsUnavailable(status) || absl::IsDeadlineExceeded(status) ||
         absl::IsResourceExhausted(status);
}

}  // namespace

WatchThread::WatchThread(v1::MapService::StubInterface& stub, SessionId session, const Backoff& backoff,
                         std::function<void(const ClientEvent&)> on_event)
    : stub_(stub), session_(session), backoff_(backoff), on_event_(std::move(on_event)), thread_([this] { Run(); }) {}

WatchThread::~WatchThread() {
  control_.Cancel();
  thread_.join();
}

void WatchThread::Run() {
  while (MayComeBack(ReadStream())) {
    if (!control_.Pause(backoff_.Next())) return;
  }
}

Status WatchThread::ReadStream() {
  grpc::ClientContext context;
  const CallControl::Registration registration(control_, context);
  v1::WatchSessionRequest request;
  request.set_session_id(static_cast<uint32_t>(session_.value()));
  const auto reader = stub_.WatchSession(&context, request);
  v1::WatchSessionResponse response;
  Status malformed;
  while (malformed.ok() && reader->Read(&response)) {
    const StatusOr<std::optional<ClientEvent>> event = ToClientEvent(response);
    if (!event.ok()) {
      malformed = event.status();
      context.TryCancel();
      continue;
    }
    if (!*event) continue;
    if (std::holds_alternative<WatchStartedEvent>(**event)) backoff_.Reset();
    on_event_(**event);
  }
  const Status status = FromGrpcStatus(reader->Finish());
  return malformed.ok() ? status : malformed;
}

}  // namespace mapp
