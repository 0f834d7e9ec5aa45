#include "mapp/client/map_client.h"

#include "api/convert/convert.h"
#include "api/status/grpc_status.h"
#include "call_control.h"
#include "mapp/base/latency.h"
#include "mapp/codec/tile_codec.h"
#include "mapp/v1/map_service.grpc.pb.h"
#include "watch_thread.h"

#include <fmt/format.h>
#include <grpcpp/channel.h>
#include <grpcpp/create_channel.h>

#include <algorithm>
#include <random>
#include <set>

namespace mapp {
namespace {

using std::chrono::milliseconds;
using std::chrono::steady_clock;

/// A shared map is a stream of many messages: its deadline in units of the other calls'.
constexpr int kStreamTimeoutFactor = 4;
/// A tile of the densest map: 8 m full of points is some megabytes.
constexpr int kMaxMessageBytes = 64 << 20;

/// Which failures a call is tried again after.
enum class RetryOn { kTransient, kUnavailable, kNothing };

bool ShouldRetry(const Status& status, RetryOn retry_on) {
  if (retry_on == RetryOn::kNothing) return false;
  if (absl::IsUnavailable(status)) return true;
  return retry_on == RetryOn::kTransient && absl::IsDeadlineExceeded(status);
}

RetryOn ForPatience(Patience patience) {
  return patience == Patience::kRetry ? RetryOn::kTransient : RetryOn::kNothing;
}

grpc::ChannelArguments ChannelArguments() {
  grpc::ChannelArguments arguments;
  arguments.SetMaxReceiveMessageSize(kMaxMessageBytes);
  // The retries here decide when to try again; the channel's own pauses must not outlast them.
  arguments.SetInt(GRPC_ARG_INITIAL_RECONNECT_BACKOFF_MS, 50);
  // In spite of its name, how long an attempt to connect may take: some networks and busy servers need seconds.
  arguments.SetInt(GRPC_ARG_MIN_RECONNECT_BACKOFF_MS, 10'000);
  arguments.SetInt(GRPC_ARG_MAX_RECONNECT_BACKOFF_MS, 1000);
  // Tells a watcher within a minute that its server has vanished without a word.
  arguments.SetInt(GRPC_ARG_KEEPALIVE_TIME_MS, 30'000);
  arguments.SetInt(GRPC_ARG_KEEPALIVE_TIMEOUT_MS, 10'000);
  arguments.SetInt(GRPC_ARG_USE_LOCAL_SUBCHANNEL_POOL, 1);
  return arguments;
}

uint32_t ToWire(SessionId session) { return static_cast<uint32_t>(session.value()); }

StatusOr<ClientUpdateVerdict> FromProto(v1::UpdateVerdict verdict) {
  switch (verdict) {
    case v1::UPDATE_VERDICT_NONE:
      return ClientUpdateVerdict::kNone;
    case v1::UPDATE_VERDICT_EXPANSION:
      return ClientUpdateVerdict::kExpansion;
    case v1::UPDATE_VERDICT_UPDATING:
      return ClientUpdateVerdict::kUpdating;
    default:
      return absl::InternalError(fmt::format("unknown verdict {}", static_cast<int>(verdict)));
  }
}

v1::RequestSharedMapRequest ToProto(SessionId session, const ClientSharedMapRequest& wanted) {
  v1::RequestSharedMapRequest request;
  request.set_session_id(ToWire(session));
  request.set_keyframe(wanted.keyframe);
  request.set_view(EncodeViewQuery(wanted.view));
  request.set_oversharing(static_cast<float>(wanted.oversharing));
  request.set_overlap(static_cast<float>(wanted.overlap));
  request.set_min_seen_by_others(static_cast<float>(wanted.min_seen_by_others));
  request.set_max_bytes(wanted.max_bytes);
  for (const ClientHeldTile& held : wanted.held_tiles) {
    v1::HeldTile& tile = *request.add_held_tiles();
    tile.set_key(held.key.Packed());
    tile.set_revision(held.revision.value());
    tile.set_crc32c(held.crc32c);
  }
  if (wanted.look_ahead.distance_m == 0) return request;
  v1::LookAhead& look_ahead = *request.mutable_look_ahead();
  look_ahead.set_distance_m(static_cast<float>(wanted.look_ahead.distance_m));
  look_ahead.set_earlier_ways(wanted.look_ahead.earlier_ways);
  v1::Point3& motion = *look_ahead.mutable_motion();
  motion.set_x_m(wanted.look_ahead.motion.x());
  motion.set_y_m(wanted.look_ahead.motion.y());
  motion.set_z_m(wanted.look_ahead.motion.z());
  return request;
}

StatusOr<std::vector<uint32_t>> HeldIndices(const google::protobuf::RepeatedField<uint32_t>& indices, size_t num_held,
                                            const char* field) {
  for (const uint32_t idx : indices) {
    if (idx >= num_held) return absl::InternalError(fmt::format("summary.{}: {} of {} held", field, idx, num_held));
  }
  return std::vector<uint32_t>(indices.begin(), indices.end());
}

Status TakeSummary(const v1::SharedMapSummary& summary, size_t num_held, ClientSharedMap& map) {
  map.map_revision = summary.map_revision();
  map.is_own_map = summary.is_own_map();
  map.num_tiles_over_budget = summary.num_tiles_over_budget();
  MAPP_ASSIGN_OR_RETURN(map.unchanged_held,
                        HeldIndices(summary.unchanged_held_tiles(), num_held, "unchanged_held_tiles"));
  MAPP_ASSIGN_OR_RETURN(map.outdated_held, HeldIndices(summary.outdated_held_tiles(), num_held, "outdated_held_tiles"));
  return absl::OkStatus();
}

Status TakeTile(std::string bytes, ClientSharedMap& map) {
  MAPP_ASSIGN_OR_RETURN(Tile tile, DecodeTile(bytes));
  map.tiles.push_back({std::move(tile), std::move(bytes)});
  return absl::OkStatus();
}

}  // namespace

Status MapClientOptions::Validate() const {
  const auto check = [](bool good, const std::string& what) -> Status {
    return good ? absl::OkStatus() : absl::InvalidArgumentError(what);
  };
  MAPP_RETURN_IF_ERROR(check(!server_address.empty(), "server_address: must be HOST:PORT"));
  MAPP_RETURN_IF_ERROR(check(call_timeout.count() > 0, "call_timeout: must be positive"));
  MAPP_RETURN_IF_ERROR(check(first_backoff.count() > 0, "first_backoff: must be positive"));
  MAPP_RETURN_IF_ERROR(check(max_backoff >= first_backoff, "max_backoff: must be at least first_backoff"));
  return check(retry_for.count() >= 0, "retry_for: must not be negative");
}

struct MapClient::Impl {
  explicit Impl(const MapClientOptions& o)
      : options(o),
        channel(grpc::CreateCustomChannel(o.server_address, grpc::InsecureChannelCredentials(), ChannelArguments())),
        stub(v1::MapService::NewStub(channel)) {}

  using Stub = v1::MapService::StubInterface;
  using Attempt = std::function<Status(grpc::ClientContext&)>;

  /// Runs `attempt`, again after failures that `retry_on` names, until options.retry_for has passed.
  Status Run(RetryOn retry_on, milliseconds attempt_timeout, const Attempt& attempt);

  /// As Run, for a unary call; `count_attempt` sees the counters once per attempt.
  template <typename Request, typename Response>
  Status Unary(grpc::Status (Stub::*method)(grpc::ClientContext*, const Request&, Response*), const Request& request,
               Response& response, RetryOn retry_on, const std::function<void(TrafficCounters&)>& count_attempt) {
    return Run(retry_on, options.call_timeout, [&](grpc::ClientContext& context) {
      Count(count_attempt);
      return FromGrpcStatus((*stub.*method)(&context, request, &response));
    });
  }

  Backoff NewBackoff() { return {options.first_backoff, options.max_backoff, std::random_device()()}; }

  void Count(const std::function<void(TrafficCounters&)>& change) {
    if (!change) return;
    MutexLock lock(mutex);
    change(traffic);
  }

  const MapClientOptions options;
  const std::shared_ptr<grpc::Channel> channel;
  const std::unique_ptr<v1::MapService::Stub> stub;
  CallControl control;
  Mutex mutex;
  TrafficCounters traffic ABSL_GUARDED_BY(mutex);
};

Status MapClient::Impl::Run(RetryOn retry_on, milliseconds attempt_timeout, const Attempt& attempt) {
  const auto give_up = steady_clock::now() + options.retry_for;
  Backoff backoff = NewBackoff();
  while (true) {
    grpc::ClientContext context;
    context.set_deadline(std::chrono::system_clock::now() + attempt_timeout);
    Status status;
    {
      const CallControl::Registration registration(control, context);
      status = attempt(context);
    }
    if (status.ok()) return status;
    if (control.cancelled()) return absl::CancelledError("the client was shut down");
    const milliseconds pause = backoff.Next();
    if (!ShouldRetry(status, retry_on) || steady_clock::now() + pause > give_up) {
      return absl::IsUnavailable(status) ? Annotate(status, "server " + options.server_address) : status;
    }
    if (!control.Pause(pause)) return absl::CancelledError("the client was shut down");
    Count([](TrafficCounters& counters) { ++counters.num_retries; });
  }
}

StatusOr<std::unique_ptr<MapClient>> MapClient::Create(const MapClientOptions& options) {
  MAPP_RETURN_IF_ERROR(options.Validate());
  return std::unique_ptr<MapClient>(new MapClient(std::make_unique<Impl>(options)));
}

MapClient::MapClient(std::unique_ptr<Impl> impl) : impl_(std::move(impl)) {}
MapClient::~MapClient() { impl_->control.Cancel(); }

StatusOr<ClientSession> MapClient::OpenSession(const std::string& map_name, const std::string& device,
                                               SensorKind sensor, const Camera& camera, const FeatureSettings& features,
                                               bool create_map) {
  v1::OpenSessionRequest request;
  request.set_map_name(map_name);
  request.set_device(device);
  request.set_sensor(ToProto(sensor));
  *request.mutable_camera() = ToProto(camera);
  *request.mutable_feature_settings() = ToProto(features);
  request.set_create_map(create_map);
  v1::OpenSessionResponse response;
  MAPP_RETURN_IF_ERROR(impl_->Unary(&Impl::Stub::OpenSession, request, response, RetryOn::kUnavailable, {}));
  return ClientSession{.id = SessionId(response.session_id()),
                       .map = MapId(response.map_id()),
                       .cone_range_m = response.cone_range_m(),
                       .tile_edge_m = response.tile_edge_m(),
                       .max_keyframe_bytes = response.max_keyframe_bytes(),
                       .map_created_ns = response.map_created_unix_ns()};
}

StatusOr<OverlapAnswer> MapClient::AssessOverlap(SessionId session, uint32_t keyframe, const ViewQuery& view,
                                                 size_t num_samples) {
  v1::AssessOverlapRequest request;
  request.set_session_id(ToWire(session));
  request.set_keyframe(keyframe);
  request.set_view(EncodeViewQuery(view));
  request.set_num_samples(static_cast<uint32_t>(num_samples));
  const uint64_t query_bytes = request.ByteSizeLong();
  v1::AssessOverlapResponse response;
  MAPP_RETURN_IF_ERROR(
      impl_->Unary(&Impl::Stub::AssessOverlap, request, response, RetryOn::kTransient, [&](TrafficCounters& counters) {
        counters.query_bytes += query_bytes;
        counters.max_query_bytes = std::max(counters.max_query_bytes, query_bytes);
      }));
  const uint64_t response_bytes = response.ByteSizeLong();
  impl_->Count([&](TrafficCounters& counters) {
    ++counters.num_queries;
    counters.response_bytes += response_bytes;
    counters.max_response_bytes = std::max(counters.max_response_bytes, response_bytes);
  });
  return DecodeOverlapAnswer(response.answer(), view, num_samples);
}

StatusOr<ClientUpload> MapClient::UploadKeyframe(const std::string& packet) {
  v1::UploadPartialKeyframeRequest request;
  request.set_keyframe(packet);
  const uint64_t bytes = request.ByteSizeLong();
  v1::UploadPartialKeyframeResponse response;
  MAPP_RETURN_IF_ERROR(impl_->Unary(&Impl::Stub::UploadPartialKeyframe, request, response, RetryOn::kTransient,
                                    [&](TrafficCounters& counters) { counters.upload_bytes += bytes; }));
  impl_->Count([](TrafficCounters& counters) { ++counters.num_uploads; });
  ClientUpload upload{
      .frame = FrameId(response.frame_id()), .already_stored = response.already_stored(), .T_map_session = {}};
  if (response.has_pose_map_session()) {
    MAPP_ASSIGN_OR_RETURN(upload.T_map_session, mapp::FromProto(response.pose_map_session(), "pose_map_session"));
    MAPP_ASSIGN_OR_RETURN(upload.scale_map_session, ScaleFromProto(response.scale_map_session(), "scale_map_session"));
  }
  return upload;
}

StatusOr<ClientSharedMap> MapClient::RequestSharedMap(
    SessionId session, const ClientSharedMapRequest& wanted, Patience patience,
    const std::function<void(const ClientSharedMap& so_far)>& on_tile) {
  const v1::RequestSharedMapRequest request = ToProto(session, wanted);
  const uint64_t request_bytes = request.ByteSizeLong();
  ClientSharedMap map;
  const auto attempt = [&](grpc::ClientContext& context) -> Status {
    map = {};
    impl_->Count([&](TrafficCounters& counters) { counters.shared_map_request_bytes += request_bytes; });
    Status malformed;
    const Stopwatch stopwatch;
    const auto reader = impl_->stub->RequestSharedMap(&context, request);
    v1::RequestSharedMapResponse response;
    while (malformed.ok() && reader->Read(&response)) {
      const uint64_t bytes = response.ByteSizeLong();
      impl_->Count([&](TrafficCounters& counters) { counters.download_bytes += bytes; });
      malformed = response.has_summary() ? TakeSummary(response.summary(), wanted.held_tiles.size(), map)
                                         : TakeTile(std::move(*response.mutable_tile()), map);
      if (!malformed.ok()) context.TryCancel();
      if (!map.tiles.empty() && !map.first_tile_after) map.first_tile_after = stopwatch.Elapsed();
      if (malformed.ok() && !response.has_summary() && on_tile) on_tile(map);
    }
    const Status status = FromGrpcStatus(reader->Finish());
    return malformed.ok() ? status : malformed;
  };
  impl_->Count([](TrafficCounters& counters) { ++counters.num_shared_map_requests; });
  MAPP_RETURN_IF_ERROR(impl_->Run(ForPatience(patience), kStreamTimeoutFactor * impl_->options.call_timeout, attempt));
  return map;
}

StatusOr<ClientUpdateVerdict> MapClient::ReportUpdate(SessionId session, const std::vector<std::string>& packets,
                                                      Patience patience) {
  v1::ReportUpdateRequest request;
  request.set_session_id(ToWire(session));
  for (const std::string& packet : packets) request.add_keyframes(packet);
  const uint64_t bytes = request.ByteSizeLong();
  v1::ReportUpdateResponse response;
  MAPP_RETURN_IF_ERROR(impl_->Unary(&Impl::Stub::ReportUpdate, request, response, ForPatience(patience),
                                    [&](TrafficCounters& counters) { counters.report_bytes += bytes; }));
  impl_->Count([](TrafficCounters& counters) { ++counters.num_reports; });
  return FromProto(response.verdict());
}

Status MapClient::ReportEvidence(SessionId session, uint32_t number, const std::string& packet, Patience patience) {
  v1::ReportEvidenceRequest request;
  request.set_session_id(ToWire(session));
  request.set_number(number);
  request.set_evidence(packet);
  const uint64_t bytes = request.ByteSizeLong();
  v1::ReportEvidenceResponse response;
  MAPP_RETURN_IF_ERROR(impl_->Unary(&Impl::Stub::ReportEvidence, request, response, ForPatience(patience),
                                    [&](TrafficCounters& counters) { counters.evidence_bytes += bytes; }));
  impl_->Count([](TrafficCounters& counters) { ++counters.num_evidence_reports; });
  return absl::OkStatus();
}

StatusOr<std::pair<uint64_t, bool>> MapClient::CloseSession(SessionId session) {
  v1::CloseSessionRequest request;
  request.set_session_id(ToWire(session));
  v1::CloseSessionResponse response;
  MAPP_RETURN_IF_ERROR(impl_->Unary(&Impl::Stub::CloseSession, request, response, RetryOn::kTransient, {}));
  return std::make_pair(response.num_keyframes(), response.optimization_pending());
}

StatusOr<std::vector<ClientKeyframePose>> MapClient::GetSessionPoses(SessionId session) {
  v1::GetSessionPosesRequest request;
  request.set_session_id(ToWire(session));
  v1::GetSessionPosesResponse response;
  MAPP_RETURN_IF_ERROR(impl_->Unary(&Impl::Stub::GetSessionPoses, request, response, RetryOn::kTransient, {}));
  std::vector<ClientKeyframePose> poses;
  for (const auto& keyframe : response.keyframes()) {
    MAPP_ASSIGN_OR_RETURN(const Pose3 T_map_camera, FromProto(keyframe.pose_map_camera(), "pose_map_camera"));
    poses.push_back({keyframe.keyframe(), keyframe.stamp_ns(), T_map_camera});
  }
  return poses;
}

std::unique_ptr<WatchHandle> MapClient::WatchSession(SessionId session,
                                                     std::function<void(const ClientEvent&)> on_event) {
  return std::make_unique<WatchThread>(*impl_->stub, session, impl_->NewBackoff(), std::move(on_event));
}

void MapClient::Cancel() { impl_->control.Cancel(); }

TrafficCounters MapClient::traffic() const {
  MutexLock lock(impl_->mutex);
  return impl_->traffic;
}

}  // namespace mapp
