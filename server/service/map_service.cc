#include "server/service/map_service.h"

#include "mapp/base/mutex.h"
#include "mapp/base/unix_time.h"
#include "mapp/codec/keyframe_codec.h"
#include "server/service/map_service_impl.h"
#include "server/service/map_settings.h"
#include "server/service/session_view.h"

#include <fmt/format.h>

#include <algorithm>
#include <utility>
#include <vector>

namespace mapp {
namespace {

constexpr size_t kMaxReportedKeyframes = 8;
constexpr double kMaxOversharing = 4;

Status Validate(const OpenSessionInput& input) {
  MAPP_RETURN_IF_ERROR(ValidateName(input.map_name, "map_name"));
  MAPP_RETURN_IF_ERROR(ValidateName(input.device, "device"));
  MAPP_RETURN_IF_ERROR(input.camera.Validate());
  MAPP_RETURN_IF_ERROR(input.features.Validate());
  if (input.sensor == SensorKind::kStereo && input.camera.stereo_baseline_m <= 0) {
    return absl::InvalidArgumentError("camera.stereo_baseline_m: must be positive for a stereo session");
  }
  return absl::OkStatus();
}

/// Features of other settings than the map's look like features and match nothing, or the wrong thing.
Status CheckFeatures(const FeatureSettings& features, const MapRecord& map) {
  const std::optional<FeatureSettingsDifference> difference = FirstDifference(map.features, features);
  if (!difference) return absl::OkStatus();
  return absl::FailedPreconditionError(fmt::format(
      "feature_settings.{}: the map \"{}\" was made with {}, this session has {}; use the map's settings or "
      "another map",
      difference->field, map.name, difference->a, difference->b));
}

StatusOr<MapRecord> FindOrCreateMap(MapWriter& writer, const OpenSessionInput& input) {
  StatusOr<MapRecord> found = writer.FindMap(input.map_name);
  if (found.ok()) MAPP_RETURN_IF_ERROR(CheckFeatures(input.features, *found));
  if (found.ok() || !absl::IsNotFound(found.status()) || !input.create_map) return found;
  MAPP_RETURN_IF_ERROR(CheckScaleIsComputedWith(input.features));
  MapRecord map;
  map.name = input.map_name;
  map.features = input.features;
  MAPP_ASSIGN_OR_RETURN(const MapId id, writer.CreateMap(map));
  return writer.GetMap(id);
}

Status Validate(const LookAhead& look_ahead) {
  if (!(look_ahead.distance_m >= 0 && look_ahead.distance_m <= kMaxLookAheadM)) {
    return absl::InvalidArgumentError(
        fmt::format("look_ahead.distance_m: must be in [0, {}], got {}", kMaxLookAheadM, look_ahead.distance_m));
  }
  if (look_ahead.motion.allFinite() && look_ahead.motion.norm() <= kMaxCoordinateM) return absl::OkStatus();
  return absl::InvalidArgumentError(
      fmt::format("look_ahead.motion: must be finite and no longer than {} m", kMaxCoordinateM));
}

StatusOr<SessionView> LoadOpenSession(MapStore& store, SessionId session) {
  MAPP_ASSIGN_OR_RETURN(const std::unique_ptr<MapReader> reader, store.Read());
  MAPP_ASSIGN_OR_RETURN(SessionView view, LoadSession(*reader, session));
  MAPP_RETURN_IF_ERROR(CheckOpen(view.session));
  MAPP_RETURN_IF_ERROR(CheckNotQuarantined(view.session));
  return view;
}

StatusOr<ReportedKeyframe> DecodeReported(const std::string& packet, const SessionView& session, size_t idx) {
  const std::string field = fmt::format("keyframes[{}]", idx);
  StatusOr<Keyframe> keyframe = DecodeKeyframe(packet);
  if (!keyframe.ok()) return Annotate(keyframe.status(), field);
  if (keyframe->session != session.session.id) {
    return absl::InvalidArgumentError(fmt::format("{}.session_id: is {}, but session {} reports it", field,
                                                  keyframe->session.value(), session.session.id.value()));
  }
  MAPP_RETURN_IF_ERROR(Annotate(Validate(*keyframe, session.camera, session.map.features), field));
  MAPP_ASSIGN_OR_RETURN(MapView view,
                        ViewInMap(session, keyframe->pose_frame, keyframe->T_frame_camera, field + ".pose"));
  return ReportedKeyframe{std::move(view), *std::move(keyframe)};
}

/// Holds a listener's events back until it has been told how things stood when it began to listen.
class OpeningGate {
 public:
  explicit OpeningGate(SessionEvents::Callback callback) : callback_(std::move(callback)) {}

  void Pass(const SessionEvent& event) {
    const MutexLock lock(mutex_);
    if (open_) {
      callback_(event);
    } else {
      held_.push_back(event);
    }
  }

  void Open(const std::vector<SessionEvent>& present) {
    const MutexLock lock(mutex_);
    for (const SessionEvent& event : present) callback_(event);
    for (const SessionEvent& event : held_) callback_(event);
    held_.clear();
    open_ = true;
  }

 private:
  const SessionEvents::Callback callback_;
  Mutex mutex_;
  bool open_ ABSL_GUARDED_BY(mutex_) = false;
  std::vector<SessionEvent> held_ ABSL_GUARDED_BY(mutex_);
};

StatusOr<SessionRecord> FindSession(MapStore& store, SessionId session) {
  MAPP_ASSIGN_OR_RETURN(const std::unique_ptr<MapReader> reader, store.Read());
  return reader->GetSession(session);
}

}  // namespace

MapService::MapService(std::unique_ptr<Impl> impl) : impl_(std::move(impl)) {}
MapService::~MapService() { Shutdown(); }

StatusOr<std::unique_ptr<MapService>> MapService::Create(MapStore& store, const MapServiceOptions& options) {
  auto impl = std::make_unique<Impl>(store, options);
  MAPP_RETURN_IF_ERROR(impl->optimizer.ResumeOwed());
  return std::unique_ptr<MapService>(new MapService(std::move(impl)));
}

void MapService::WaitUntilIdle() {
  impl_->registrar.WaitUntilIdle();
  impl_->optimizer.WaitUntilIdle();
}

void MapService::Shutdown() {
  impl_->registrar.Shutdown();
  impl_->optimizer.Shutdown();
  impl_->shared_map.Shutdown();
}

StatusOr<OpenedSession> MapService::OpenSession(const CallContext& context, const OpenSessionInput& input) {
  MAPP_RETURN_IF_ERROR(Validate(input));
  OpenedSession opened;
  MAPP_RETURN_IF_ERROR(impl_->store.Write(context, [&](MapWriter& writer) -> Status {
    MAPP_ASSIGN_OR_RETURN(opened.map, FindOrCreateMap(writer, input));
    SessionRecord session;
    session.map = opened.map.id;
    session.device = input.device;
    session.sensor = input.sensor;
    MAPP_ASSIGN_OR_RETURN(session.camera, writer.InsertCamera(input.camera));
    MAPP_ASSIGN_OR_RETURN(opened.session, writer.InsertSession(session));
    return absl::OkStatus();
  }));
  return opened;
}

StatusOr<AssessedOverlap> MapService::AssessOverlap(const CallContext& context, SessionId session,
                                                    const ViewQuery& view, int num_samples) {
  MAPP_RETURN_IF_ERROR(context.Check());
  if (num_samples < 1 || num_samples > kMaxFeatures) {
    return absl::InvalidArgumentError(
        fmt::format("num_samples: must be in [1, {}], got {}", kMaxFeatures, num_samples));
  }
  MAPP_ASSIGN_OR_RETURN(const SessionView open, LoadOpenSession(impl_->store, session));
  MAPP_RETURN_IF_ERROR(CheckMeasuresDepth(open.session));
  MAPP_ASSIGN_OR_RETURN(const MapView map_view, ViewInMap(open, view.pose_frame, view.T_frame_camera, "view.pose"));
  MAPP_ASSIGN_OR_RETURN(OverlapAnswer answer, AssessView(impl_->tiles, map_view, view, num_samples));
  return AssessedOverlap{std::move(answer), open.map.revision};
}

StatusOr<UploadResult> MapService::UploadKeyframe(const CallContext& context, const std::string& packet) {
  return impl_->integrator.Integrate(context, packet);
}

StatusOr<SharedMapResult> MapService::RequestSharedMap(const CallContext& context, const SharedMapInput& input,
                                                       const std::function<Status(const std::string& tile)>& send) {
  if (!(input.oversharing >= 1 && input.oversharing <= kMaxOversharing)) {
    return absl::InvalidArgumentError(
        fmt::format("oversharing: must be in [1, {}], got {}", kMaxOversharing, input.oversharing));
  }
  if (!(input.min_seen_by_others >= 0 && input.min_seen_by_others <= 1)) {
    return absl::InvalidArgumentError(
        fmt::format("min_seen_by_others: must be in [0, 1], got {}", input.min_seen_by_others));
  }
  MAPP_RETURN_IF_ERROR(Validate(input.look_ahead));
  MAPP_ASSIGN_OR_RETURN(const SessionView open, LoadOpenSession(impl_->store, input.session));
  MAPP_RETURN_IF_ERROR(CheckMeasuresDepth(open.session));
  MAPP_ASSIGN_OR_RETURN(const MapView view,
                        ViewInMap(open, input.view.pose_frame, input.view.T_frame_camera, "view.pose"));
  if (input.min_seen_by_others > 0) {
    MAPP_ASSIGN_OR_RETURN(const double share, ShareSeenByOthers(impl_->tiles, view.map, view.Cone(), input.session));
    if (share < input.min_seen_by_others) return SharedMapResult{.map_revision = open.map.revision, .is_own_map = true};
  }
  SharedMapWish wish{view, input.oversharing, input.look_ahead, input.held_tiles, input.max_bytes};
  if (input.view.pose_frame == PoseFrame::kSession) {
    wish.look_ahead.motion = open.session.T_map_session->rotation() * input.look_ahead.motion;
  }
  return impl_->shared_map.Send(context, wish, send);
}

StatusOr<UpdateResult> MapService::ReportUpdate(const CallContext& context, SessionId session,
                                                const std::vector<std::string>& packets) {
  if (packets.empty() || packets.size() > kMaxReportedKeyframes) {
    return absl::InvalidArgumentError(
        fmt::format("keyframes: must be 1 to {}, got {}", kMaxReportedKeyframes, packets.size()));
  }
  MAPP_ASSIGN_OR_RETURN(const SessionView open, LoadOpenSession(impl_->store, session));
  MAPP_RETURN_IF_ERROR(CheckMeasuresDepth(open.session));
  std::vector<ReportedKeyframe> reported;
  for (size_t i = 0; i < packets.size(); ++i) {
    MAPP_RETURN_IF_ERROR(context.Check());
    MAPP_ASSIGN_OR_RETURN(ReportedKeyframe keyframe, DecodeReported(packets[i], open, i));
    reported.push_back(std::move(keyframe));
  }
  return CompareWithMap(impl_->tiles, reported, impl_->update_options);
}

StatusOr<StoredEvidence> MapService::ReportEvidence(const CallContext& context, SessionId session, uint32_t number,
                                                    const std::string& packet) {
  return impl_->evidence.Take(context, session, number, packet);
}

StatusOr<ClosedSession> MapService::CloseSession(const CallContext& context, SessionId session) {
  ClosedSession closed;
  bool just_closed = false;
  MapId map;
  const auto close = [&](MapWriter& writer) -> Status {
    MAPP_ASSIGN_OR_RETURN(SessionRecord record, writer.GetSession(session));
    closed.num_keyframes = record.num_keyframes;
    // A fragment is left as it is.
    closed.optimization_pending = record.T_map_session.has_value() && !record.optimized;
    if (record.closed_ns) return absl::OkStatus();
    just_closed = true;
    map = record.map;
    record.closed_ns = UnixNowNs();
    return writer.UpdateSession(record);
  };
  const auto queue_optimization = [&] {
    if (just_closed && closed.optimization_pending) impl_->registrar.OnSessionClosed(map, session);
  };
  MAPP_RETURN_IF_ERROR(impl_->store.Write(context, close, queue_optimization));
  return closed;
}

StatusOr<std::unique_ptr<SessionEvents::Subscription>> MapService::WatchSession(const CallContext& context,
                                                                                SessionId session,
                                                                                SessionEvents::Callback callback) {
  MAPP_RETURN_IF_ERROR(context.Check());
  MAPP_ASSIGN_OR_RETURN(const SessionRecord known, FindSession(impl_->store, session));
  auto gate = std::make_shared<OpeningGate>(std::move(callback));
  auto subscription =
      impl_->events.Subscribe(session, known.map, [gate](const SessionEvent& event) { gate->Pass(event); });
  // Read after subscribing: an alignment that this misses arrives as an event.
  MAPP_ASSIGN_OR_RETURN(const SessionRecord present, FindSession(impl_->store, session));
  std::vector<SessionEvent> standing;
  if (present.T_map_session) {
    standing.emplace_back(
        SessionAligned{*present.T_map_session, present.aligned_at_keyframe.value_or(0), present.scale_map_session});
  }
  if (present.IsQuarantined()) standing.emplace_back(SessionQuarantined{present.quarantine->reason});
  gate->Open(standing);
  return subscription;
}

StatusOr<SessionPoses> MapService::GetSessionPoses(const CallContext& context, SessionId session) {
  MAPP_RETURN_IF_ERROR(context.Check());
  MAPP_ASSIGN_OR_RETURN(const std::unique_ptr<MapReader> reader, impl_->store.Read());
  MAPP_ASSIGN_OR_RETURN(const SessionView known, LoadSession(*reader, session));
  if (!known.session.T_map_session) {
    return absl::FailedPreconditionError(
        fmt::format("session {} is not aligned with its map yet: its keyframes have no pose there", session.value()));
  }
  SessionPoses poses{.frames = {}, .map_revision = known.map.revision};
  MAPP_ASSIGN_OR_RETURN(poses.frames, reader->ListFrames(known.map.id, session));
  std::erase_if(poses.frames, [](const FrameRecord& frame) { return !frame.in_map; });
  std::ranges::sort(poses.frames, {}, &FrameRecord::number);
  return poses;
}

}  // namespace mapp
