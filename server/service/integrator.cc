#include "server/service/integrator.h"

#include "mapp/codec/keyframe_codec.h"
#include "server/service/frame_view.h"
#include "server/service/keyframe_writer.h"
#include "server/service/map_scale.h"
#include "server/service/median.h"
#include "server/service/registrar.h"
#include "server/service/replay_guide.h"
#include "server/service/session_events.h"
#include "server/service/session_guard.h"
#include "server/service/session_view.h"
#include "server/service/step_times.h"
#include "server/service/tile_cache.h"
#include "storage/map_store.h"

#include <fmt/format.h>

#include <limits>
#include <optional>
#include <unordered_map>
#include <utility>

namespace mapp {

/// A keyframe as it arrived, and its session before the transaction.
struct Integrator::Upload {
  const std::string& packet;
  SessionView view;
  Keyframe keyframe;  ///< lengths in the map's unit, as far as `view` knows it
  /// By feature: the point that the session's own number for it stands for already.
  std::vector<std::optional<MapPointId>> known_points;
  Associations associations;
  std::optional<FrameId> logged_frame;  ///< a frame of the log that is to enter the map
};

struct Integrator::Outcome {
  UploadResult result;
  bool in_map = false;
  bool admitted = true;
  Finding finding = Finding::kSilent;
  std::vector<TileChange> changes;
  std::optional<QuarantinedSession> quarantined;
  std::optional<RescaledMap> rescaled;
};

namespace {

/// As AssociationOptions::max_depth_error_ratio, of depths that were triangulated.
constexpr double kTriangulatedDepthError = 0.15;

bool MayFound(SensorKind sensor) { return sensor != SensorKind::kMonoInertial; }

StatusOr<UploadResult> StoredBefore(MapReader& reader, const SessionRecord& session, FrameId frame) {
  MAPP_ASSIGN_OR_RETURN(const MapRecord map, reader.GetMap(session.map));
  return UploadResult{frame, true, map.revision, session.T_map_session, session.scale_map_session};
}

/// Of the keyframe's points; nullopt when it has none.
std::optional<double> MedianDepth(const Keyframe& keyframe) {
  std::vector<double> depths;
  for (const KeyframeFeature& feature : keyframe.features) {
    if (feature.point) depths.push_back(feature.point->depth_m);
  }
  if (depths.empty()) return std::nullopt;
  return Median(std::move(depths));
}

/// Whether the map's frame is that of a session of which nothing is left, nor of any other.
StatusOr<bool> IsLeftEmpty(MapReader& reader, const MapRecord& map) {
  if (map.num_frames > 0) return false;
  MAPP_ASSIGN_OR_RETURN(const SessionRecord founder, reader.GetSession(*map.founder));
  return founder.IsQuarantined();
}

/// Sessions whose place was told in the frame that the map has had are fragments again.
Status Unalign(MapWriter& writer, MapId map) {
  MAPP_ASSIGN_OR_RETURN(const std::vector<SessionRecord> sessions, writer.ListSessions(map));
  for (SessionRecord session : sessions) {
    if (!session.T_map_session) continue;
    session.T_map_session.reset();
    session.scale_map_session = 1;
    session.aligned_at_keyframe.reset();
    MAPP_RETURN_IF_ERROR(writer.UpdateSession(session));
  }
  return writer.SetMetricScale(map, true);
}

/// The session's first keyframe makes its frame the map's, if nobody's has.
Status FoundMapIfFirst(MapWriter& writer, const Keyframe& keyframe, const EvidenceOptions& evidence,
                       SessionRecord& session) {
  if (session.T_map_session || !MayFound(session.sensor)) return absl::OkStatus();
  // Everybody after it would be measured by it.
  if (IsFalse(JudgeDepths(keyframe, session.sensor, evidence).finding)) return absl::OkStatus();
  MAPP_ASSIGN_OR_RETURN(const MapRecord map, writer.GetMap(session.map));
  if (map.founder) {
    MAPP_ASSIGN_OR_RETURN(const bool is_left_empty, IsLeftEmpty(writer, map));
    if (!is_left_empty) return absl::OkStatus();
    MAPP_RETURN_IF_ERROR(Unalign(writer, map.id));
  }
  if (!MeasuresDepth(session.sensor)) {
    const std::optional<double> depth = MedianDepth(keyframe);
    if (!depth) return absl::OkStatus();
    session.scale_map_session = kNominalDepthM / *depth;
    MAPP_RETURN_IF_ERROR(writer.SetMetricScale(map.id, false));
  }
  MAPP_RETURN_IF_ERROR(writer.SetFounder(map.id, session.id));
  session.T_map_session = Pose3();
  session.aligned_at_keyframe = keyframe.number;
  return writer.UpdateSession(session);
}

/// T_map_camera for an aligned session, T_session_camera for a fragment's; of a keyframe in its session's present unit.
StatusOr<Pose3> PoseToStore(const SessionRecord& session, const Keyframe& keyframe) {
  if (session.T_map_session || keyframe.pose_frame == PoseFrame::kMap) {
    return PoseInMap(session, keyframe.pose_frame, keyframe.T_frame_camera, "keyframe.pose");
  }
  return keyframe.T_frame_camera;
}

std::vector<std::optional<MapPointId>> ByFeature(const Keyframe& keyframe, const std::vector<size_t>& feature_idxs,
                                                 const std::vector<std::optional<MapPointId>>& found) {
  std::vector<std::optional<MapPointId>> points(keyframe.features.size());
  for (size_t i = 0; i < feature_idxs.size(); ++i) points[feature_idxs[i]] = found[i];
  return points;
}

StatusOr<std::vector<std::optional<MapPointId>>> FindKnownPoints(MapReader& reader, const Keyframe& keyframe) {
  std::vector<uint64_t> numbers;
  std::vector<size_t> feature_idxs;
  for (size_t i = 0; i < keyframe.features.size(); ++i) {
    const std::optional<PointReference>& reference = keyframe.features[i].point;
    if (!reference || reference->kind != PointReference::Kind::kSessionPoint) continue;
    numbers.push_back(reference->id);
    feature_idxs.push_back(i);
  }
  MAPP_ASSIGN_OR_RETURN(const auto found, reader.FindSessionPoints(keyframe.session, numbers));
  return ByFeature(keyframe, feature_idxs, found);
}

}  // namespace

Integrator::Integrator(MapStore& store, TileCache& tiles, SessionEvents& events, Registrar& registrar,
                       SessionGuard& guard, const IntegratorOptions& options)
    : store_(store), tiles_(tiles), events_(events), registrar_(registrar), guard_(guard), options_(options) {}

StatusOr<UploadResult> Integrator::Integrate(const CallContext& context, const std::string& packet) {
  if (packet.size() > options_.max_packet_bytes) {
    return absl::InvalidArgumentError(
        fmt::format("keyframe: at most {} bytes, got {}", options_.max_packet_bytes, packet.size()));
  }
  Upload upload{packet, {}, {}, {}, {}, std::nullopt};
  MAPP_ASSIGN_OR_RETURN(upload.keyframe, DecodeKeyframe(packet));
  {
    MAPP_ASSIGN_OR_RETURN(const std::unique_ptr<MapReader> reader, store_.Read());
    MAPP_ASSIGN_OR_RETURN(upload.view, LoadSession(*reader, upload.keyframe.session));
    MAPP_RETURN_IF_ERROR(Validate(upload.keyframe, upload.view.camera, upload.view.map.features));
    MAPP_ASSIGN_OR_RETURN(const auto stored, reader->FindFrame(upload.keyframe.session, upload.keyframe.number));
    if (stored) return StoredBefore(*reader, upload.view.session, *stored);
    if (options_.replay != nullptr) MAPP_RETURN_IF_ERROR(options_.replay->translate(*reader, upload.keyframe));
    ScaleLengths(upload.keyframe, upload.view.session.scale_map_session);
    MAPP_RETURN_IF_ERROR(CheckOpen(upload.view.session));
    MAPP_RETURN_IF_ERROR(CheckNotQuarantined(upload.view.session));
    MAPP_ASSIGN_OR_RETURN(upload.known_points, FindKnownPoints(*reader, upload.keyframe));
  }
  const Stopwatch associating;
  if (upload.view.session.T_map_session) {
    MAPP_ASSIGN_OR_RETURN(upload.associations, Associate(upload));
  }
  const std::chrono::nanoseconds association_time = associating.Elapsed();
  Outcome outcome;
  const auto store = [&](MapWriter& writer) {
    const Stopwatch storing;
    Status status = Store(writer, upload, outcome);
    if (options_.step_times != nullptr && status.ok() && !outcome.result.already_stored) {
      options_.step_times->Add(ServiceStep::kIntegration, association_time + storing.Elapsed());
    }
    return status;
  };
  MAPP_RETURN_IF_ERROR(store_.Write(context, store, [&] { Announce(upload, outcome); }));
  return outcome.result;
}

StatusOr<Associations> Integrator::Associate(const Upload& upload) const {
  MAPP_ASSIGN_OR_RETURN(const MapView view, ViewInMap(upload.view, upload.keyframe.pose_frame,
                                                      upload.keyframe.T_frame_camera, "keyframe.pose"));
  std::vector<size_t> unknown;
  std::unordered_map<MapPointId, size_t> taken;
  for (size_t i = 0; i < upload.keyframe.features.size(); ++i) {
    const std::optional<PointReference>& reference = upload.keyframe.features[i].point;
    if (!reference) continue;
    if (upload.known_points[i]) taken.emplace(*upload.known_points[i], i);
    if (reference->kind == PointReference::Kind::kMapPoint) taken.emplace(MapPointId(reference->id), i);
    // A map point's id may be out of date; the writer falls back on the association then.
    if (!upload.known_points[i]) unknown.push_back(i);
  }
  MAPP_ASSIGN_OR_RETURN(const auto tiles, tiles_.TilesInBox(view.map, view.Cone().BoundingBox()));
  AssociationOptions options = options_.association;
  if (!MeasuresDepth(upload.view.session.sensor)) options.max_depth_error_ratio = kTriangulatedDepthError;
  return AssociateFeatures(view, upload.keyframe, unknown, tiles, taken, options);
}

Keyframe Integrator::InUnitOf(const SessionRecord& session, const Upload& upload) {
  Keyframe keyframe = upload.keyframe;
  // Between the first look and now the session may have been aligned, or its map rescaled.
  ScaleLengths(keyframe, session.scale_map_session / upload.view.session.scale_map_session);
  return keyframe;
}

Status Integrator::Store(MapWriter& writer, const Upload& upload, Outcome& outcome) const {
  // Read again: since the first look, the same keyframe may have been stored, or the session closed or aligned.
  MAPP_ASSIGN_OR_RETURN(SessionRecord session, writer.GetSession(upload.keyframe.session));
  MAPP_ASSIGN_OR_RETURN(const auto stored, writer.FindFrame(session.id, upload.keyframe.number));
  if (stored) {
    MAPP_ASSIGN_OR_RETURN(outcome.result, StoredBefore(writer, session, *stored));
    return absl::OkStatus();
  }
  MAPP_RETURN_IF_ERROR(CheckOpen(session));
  MAPP_RETURN_IF_ERROR(CheckNotQuarantined(session));
  MAPP_RETURN_IF_ERROR(FoundMapIfFirst(writer, upload.keyframe, guard_.evidence_options(), session));
  const Keyframe keyframe = InUnitOf(session, upload);
  MAPP_ASSIGN_OR_RETURN(const Pose3 T_frame_camera, PoseToStore(session, keyframe));
  outcome.in_map = session.T_map_session.has_value();
  KeyframeEvidence evidence;
  const auto admit = [&](std::span<const KnownPoint> known) {
    if (options_.replay != nullptr) return !outcome.in_map || options_.replay->admits(session.id, keyframe.number);
    // An operator's word is the last one.
    if (!session.quarantine) evidence = Judge(upload, keyframe, T_frame_camera, known);
    // A fragment is compared as a whole before it may merge.
    return !outcome.in_map || !IsFalse(evidence.finding);
  };
  MAPP_ASSIGN_OR_RETURN(WrittenKeyframe written,
                        WriteKeyframe(writer, {keyframe, upload.packet, upload.view.camera, session, outcome.in_map,
                                               T_frame_camera, upload.associations.found, admit, upload.logged_frame}));
  outcome.admitted = written.admitted;
  outcome.finding = evidence.finding;
  outcome.result = {written.frame, false, written.revision, session.T_map_session, session.scale_map_session};
  outcome.changes = std::move(written.changes);
  MAPP_ASSIGN_OR_RETURN(outcome.quarantined, guard_.Note(writer, session, upload.keyframe.number, evidence));
  if (outcome.in_map && written.admitted) {
    MAPP_ASSIGN_OR_RETURN(outcome.rescaled, KeepNominalScale(writer, session));
  }
  if (outcome.rescaled) {
    MAPP_ASSIGN_OR_RETURN(session, writer.GetSession(session.id));
    outcome.result.T_map_session = session.T_map_session;
    outcome.result.scale_map_session = session.scale_map_session;
  }
  return absl::OkStatus();
}

KeyframeEvidence Integrator::Judge(const Upload& upload, const Keyframe& keyframe, const Pose3& T_frame_camera,
                                   std::span<const KnownPoint> known) const {
  EvidenceOptions options = guard_.evidence_options();
  const SensorKind sensor = upload.view.session.sensor;
  // What a single camera has triangulated changes while its map ripens: then it says nothing against the session.
  if (!MeasuresDepth(sensor)) {
    options.max_depth_off_ratio = std::numeric_limits<double>::infinity();
    options.depth_tolerance = std::numeric_limits<double>::infinity();
  }
  const KeyframeEvidence depths = JudgeDepths(keyframe, sensor, options);
  if (IsFalse(depths.finding)) return depths;
  const KeyframeEvidence own = JudgeKnownPoints(keyframe, upload.view.camera, T_frame_camera, known, options);
  if (IsFalse(own.finding)) return own;
  const KeyframeEvidence map = JudgeComparison(upload.associations.comparison, options);
  return map.finding == Finding::kSilent ? own : map;
}

void Integrator::Announce(const Upload& upload, const Outcome& outcome) const {
  if (outcome.result.already_stored) return;
  const MapId map = upload.view.map.id;
  if (outcome.rescaled) {
    AnnounceRescaled(tiles_, events_, map, outcome.result.map_revision, *outcome.rescaled);
  } else if (!outcome.changes.empty()) {
    tiles_.Apply(map, outcome.result.map_revision, outcome.changes);
    TilesChanged event{{}, outcome.result.map_revision};
    for (const TileChange& change : outcome.changes) event.keys.push_back(change.key);
    events_.PublishToMap(map, event);
  }
  if (outcome.quarantined) guard_.Announce(*outcome.quarantined);
  if (outcome.in_map && !outcome.admitted) return;
  registrar_.OnKeyframeStored(map, upload.keyframe.session, outcome.result.frame, outcome.in_map,
                              outcome.finding == Finding::kDoubtful);
}

StatusOr<size_t> Integrator::IntegrateLeftOut(const CallContext& context, SessionId session) {
  std::vector<FrameRecord> frames;
  {
    MAPP_ASSIGN_OR_RETURN(const std::unique_ptr<MapReader> reader, store_.Read());
    MAPP_ASSIGN_OR_RETURN(const SessionRecord record, reader->GetSession(session));
    if (!record.T_map_session) return 0;
    MAPP_ASSIGN_OR_RETURN(frames, reader->ListFrames(record.map, session));
  }
  std::erase_if(frames, [](const FrameRecord& frame) { return frame.in_map; });
  for (const FrameRecord& frame : frames) MAPP_RETURN_IF_ERROR(IntegrateLogged(context, frame.id));
  return frames.size();
}

Status Integrator::IntegrateLogged(const CallContext& context, FrameId frame) {
  std::string packet;
  Upload upload{packet, {}, {}, {}, {}, frame};
  {
    MAPP_ASSIGN_OR_RETURN(const std::unique_ptr<MapReader> reader, store_.Read());
    MAPP_ASSIGN_OR_RETURN(FrameView view, LoadFrame(*reader, frame));
    MAPP_ASSIGN_OR_RETURN(packet, reader->GetPacket(frame));
    upload.keyframe = std::move(view.keyframe);  // in the map's unit already
    MAPP_ASSIGN_OR_RETURN(upload.view, LoadSession(*reader, upload.keyframe.session));
    // It may have been corrected while it stood in the map.
    const Pose3& T_session_camera = view.record.T_frame_camera;
    upload.keyframe.pose_frame = PoseFrame::kSession;
    upload.keyframe.T_frame_camera =
        Pose3(T_session_camera.rotation(), upload.view.session.scale_map_session * T_session_camera.translation());
    MAPP_ASSIGN_OR_RETURN(upload.known_points, FindKnownPoints(*reader, upload.keyframe));
  }
  MAPP_ASSIGN_OR_RETURN(upload.associations, Associate(upload));
  Outcome outcome;
  outcome.in_map = true;
  const auto store = [&](MapWriter& writer) -> Status {
    MAPP_ASSIGN_OR_RETURN(const SessionRecord session, writer.GetSession(upload.keyframe.session));
    const Keyframe keyframe = InUnitOf(session, upload);
    MAPP_ASSIGN_OR_RETURN(const Pose3 T_map_camera, PoseToStore(session, keyframe));
    MAPP_RETURN_IF_ERROR(writer.SetCause(session.map, RevisionCause::kReturn, session.id));
    MAPP_ASSIGN_OR_RETURN(WrittenKeyframe written, WriteKeyframe(writer, {keyframe,
                                                                          upload.packet,
                                                                          upload.view.camera,
                                                                          session,
                                                                          /*in_map=*/true,
                                                                          T_map_camera,
                                                                          upload.associations.found,
                                                                          {},
                                                                          upload.logged_frame}));
    outcome.result = {written.frame, false, written.revision, session.T_map_session, session.scale_map_session};
    outcome.changes = std::move(written.changes);
    return absl::OkStatus();
  };
  return store_.Write(context, store, [&] { Announce(upload, outcome); });
}

}  // namespace mapp
