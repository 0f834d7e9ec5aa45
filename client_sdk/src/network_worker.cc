#include "network_worker.h"

#include "mapp/base/latency.h"
#include "mapp/base/process_usage.h"
#include "mapp/codec/keyframe_codec.h"

#include <string>
#include <utility>

namespace mapp {
namespace {

/// Tiles kept in memory: at some 100 KB each a few hundred MB, which is a building.
constexpr size_t kMaxHeldTiles = 2048;
/// With so many the tiles that have come are of use before the others are there: over a slow link these take seconds.
constexpr size_t kMinEarlyPoints = 300;
/// Between rounds of retries while the server stays away; MapClient has its own pauses within a round.
constexpr std::chrono::milliseconds kPauseBetweenRounds{500};

/// The server may do better later: what failed is tried again.
bool IsTransient(const Status& status) { return absl::IsUnavailable(status) || absl::IsDeadlineExceeded(status); }

void NoteError(SessionProgress& progress, const Status& status) {
  progress.UpdateStats([&](ParticipantStats& stats) { stats.last_error = status.ToString(); });
}

void NoteIfFailed(SessionProgress& progress, const Status& status) {
  if (!status.ok()) NoteError(progress, status);
}

}  // namespace

NetworkWorker::NetworkWorker(MapClient& client, SessionProgress& progress, SlamAdapter* adapter,
                             const SessionSetup& setup)
    : client_(client),
      progress_(progress),
      adapter_(adapter),
      setup_(setup),
      options_(setup_.participation),
      camera_(setup_.camera) {}

Status NetworkWorker::Open() {
  if (!session_) {
    MAPP_ASSIGN_OR_RETURN(session_, client_.OpenSession(options_.map_name, options_.device, setup_.sensor, camera_,
                                                        options_.features, options_.create_map));
    tiles_.emplace(session_->tile_edge_m, kMaxHeldTiles, camera_, OpenTileFolder());
    evidence_.emplace(camera_, session_->cone_range_m);
    rng_ = Rng(session_->id.value());
    progress_.OnOpened(session_->id);
    watch_ = client_.WatchSession(session_->id, [this](const ClientEvent& event) { progress_.OnEvent(event); });
  }
  return progress_.WaitForWatch(std::chrono::steady_clock::now() + setup_.client.call_timeout);
}

std::unique_ptr<TileFolder> NetworkWorker::OpenTileFolder() {
  // Without its identity a map cannot be told from another of the same number.
  if (options_.tile_cache.folder.empty() || session_->map_created_ns == 0) return nullptr;
  StatusOr<std::unique_ptr<TileFolder>> folder =
      TileFolder::Open(options_.tile_cache, {session_->map, session_->map_created_ns});
  if (folder.ok()) return *std::move(folder);
  NoteError(progress_, folder.status());
  return nullptr;
}

bool NetworkWorker::OpenWhenPossible() {
  if (session_) return true;
  if (!progress_.WaitUntilWorthOpening()) return false;
  while (true) {
    const Status status = Open();
    if (status.ok()) return true;
    if (control_.cancelled()) return false;
    NoteError(progress_, status);
    if (!IsTransient(status)) {
      progress_.OnOpeningRefused(Annotate(status, "opening the session of a new fragment"));
      return false;
    }
    if (!control_.Pause(kPauseBetweenRounds)) return false;
  }
}

void NetworkWorker::Run() {
  if (!OpenWhenPossible()) return;
  while (const std::optional<Job> job = progress_.NextJob()) {
    const double cpu_before_s = ThreadCpuSeconds();
    std::visit([this](const auto& some_job) { Handle(some_job); }, *job);
    const double cpu_s = ThreadCpuSeconds() - cpu_before_s;
    progress_.UpdateStats([&](ParticipantStats& stats) { stats.network_cpu_s += cpu_s; });
    progress_.JobDone();
  }
}

void NetworkWorker::Handle(const KeyframeJob& job) {
  while (true) {
    const Status status = Process(job);
    if (status.ok() || control_.cancelled()) return;
    NoteError(progress_, status);
    if (!IsTransient(status)) {
      progress_.UpdateStats([](ParticipantStats& stats) { ++stats.num_rejected; });
      return;
    }
    if (!control_.Pause(kPauseBetweenRounds)) return;
  }
}

Status NetworkWorker::Process(const KeyframeJob& job) {
  // What is asked about a view, and what would be shared, is in the map's unit of length: not a single camera's.
  const bool has_scale = setup_.sensor != SensorKind::kMono;
  const bool whole = options_.policy == UploadPolicy::kUploadAll || job.is_evidence || !has_scale ||
                     progress_.state() == ParticipantState::kRegistering;
  Keyframe keyframe = job.keyframe;
  if (job.localized_on_map) PlaceInMap(keyframe);
  if (!whole) return Expand(std::move(keyframe));
  MAPP_RETURN_IF_ERROR(Upload(keyframe));
  if (options_.policy == UploadPolicy::kMap && has_scale) last_registering_ = std::move(keyframe);
  return absl::OkStatus();
}

void NetworkWorker::Handle(const ViewJob& job) {
  const bool has_new_report = evidence_->Add(job.keyframe, job.shared_map_number);
  // One attempt: the next job may be a failure on the shared map, for which the device waits.
  if (has_new_report) NoteIfFailed(progress_, DeliverEvidence(Patience::kOneAttempt));
}

Status NetworkWorker::DeliverEvidence(Patience patience) {
  while (evidence_->has_reports()) {
    const EvidenceReport& report = evidence_->NextReport();
    const Status status = client_.ReportEvidence(session_->id, report.number, report.packet, patience);
    if (!status.ok() && (IsTransient(status) || absl::IsResourceExhausted(status) || control_.cancelled())) {
      return status;
    }
    NoteIfFailed(progress_, status);
    evidence_->DropNextReport();
  }
  return absl::OkStatus();
}

void NetworkWorker::Handle(const CloseJob&) {
  evidence_->Conclude();
  while (true) {
    if (const Status told = DeliverEvidence(Patience::kRetry); IsTransient(told)) {
      NoteError(progress_, told);
      progress_.OnCloseFailed(told);
      if (!control_.Pause(kPauseBetweenRounds)) return;
      continue;
    } else {
      NoteIfFailed(progress_, told);  // too much for the server: it goes without the rest
    }
    const auto closed = client_.CloseSession(session_->id);
    if (closed.ok()) {
      progress_.OnClosed(/*optimization_pending=*/closed->second);
      return;
    }
    if (control_.cancelled()) return;
    NoteError(progress_, closed.status());
    if (!IsTransient(closed.status())) {
      progress_.OnCloseRefused(closed.status());
      return;
    }
    progress_.OnCloseFailed(closed.status());
    if (!control_.Pause(kPauseBetweenRounds)) return;
  }
}

bool NetworkWorker::MayShare() const { return options_.sharing && !progress_.closing(); }

void NetworkWorker::Handle(const AlignedJob&) {
  if (!MayShare() || !last_registering_ || progress_.state() != ParticipantState::kExpanding) return;
  const Keyframe keyframe = *std::exchange(last_registering_, std::nullopt);
  const OwnPoints own = OwnPointsOf(keyframe, camera_);
  if (own.p_camera.empty()) return;
  const StatusOr<std::optional<Assessment>> assessment = Assess(keyframe, own);
  if (!assessment.ok()) {
    NoteError(progress_, assessment.status());
    return;
  }
  if (!*assessment || (*assessment)->count.overlap < options_.seen_overlap) return;
  const StatusOr<bool> shared = Share(keyframe, (*assessment)->count.overlap, Patience::kRetry);
  if (!shared.ok()) NoteError(progress_, shared.status());
}

Status NetworkWorker::Upload(Keyframe keyframe) {
  keyframe.session = session_->id;
  const std::string packet = EncodeKeyframe(keyframe);
  const Stopwatch stopwatch;
  MAPP_ASSIGN_OR_RETURN(const ClientUpload upload, client_.UploadKeyframe(packet));
  progress_.RecordLatency(Step::kKeyframeUpload, stopwatch.Elapsed());
  progress_.OnUploaded(keyframe.number, upload);
  return absl::OkStatus();
}

Status NetworkWorker::Expand(Keyframe keyframe) {
  const OwnPoints own = OwnPointsOf(keyframe, camera_);
  if (own.p_camera.empty()) return Skip();
  MAPP_ASSIGN_OR_RETURN(const std::optional<Assessment> assessment, Assess(keyframe, own));
  if (!assessment) return Upload(std::move(keyframe));
  const OverlapCount& count = assessment->count;
  keyframe.overlap = static_cast<float>(count.overlap);

  bool known = count.overlap >= options_.seen_overlap;
  if (known && MayShare() && progress_.state() != ParticipantState::kSharing) {
    MAPP_ASSIGN_OR_RETURN(known, Share(keyframe, count.overlap, Patience::kRetry));
  }
  if (known) return Skip();
  const Stopwatch stopwatch;
  const Reduced reduced = RemoveRedundant(keyframe, own, count.redundant, options_.injection, rng_);
  progress_.RecordLatency(Step::kRedundancyControl, assessment->counting_time + stopwatch.Elapsed());
  return reduced.num_fresh == 0 ? Skip() : Upload(reduced.keyframe);
}

Status NetworkWorker::Skip() {
  progress_.UpdateStats([](ParticipantStats& stats) { ++stats.num_skipped; });
  return absl::OkStatus();
}

StatusOr<std::optional<NetworkWorker::Assessment>> NetworkWorker::Assess(const Keyframe& keyframe,
                                                                         const OwnPoints& own) {
  const ViewQuery view{.pose_frame = keyframe.pose_frame,
                       .T_frame_camera = keyframe.T_frame_camera,
                       .sampler = options_.sampler,
                       .sketch = MakeQuerySketch(options_.sampler, camera_, own.p_camera)};
  const Stopwatch round_trip;
  const StatusOr<OverlapAnswer> answer =
      client_.AssessOverlap(session_->id, keyframe.number, view, static_cast<size_t>(options_.num_samples));
  if (absl::IsFailedPrecondition(answer.status())) return std::nullopt;
  MAPP_RETURN_IF_ERROR(answer.status());
  progress_.RecordLatency(Step::kOverlapAssessment, round_trip.Elapsed());
  const Stopwatch counting;
  const OverlapQuestion question{camera_, session_->cone_range_m, view.sampler, view.sketch, options_.num_samples};
  OverlapCount count = CountOverlap(question, *answer, own.p_camera);
  const std::chrono::nanoseconds counting_time = counting.Elapsed();
  progress_.UpdateStats([&](ParticipantStats& stats) {
    stats.overlap_sum += count.overlap;
    ++stats.num_overlaps;
  });
  return Assessment{std::move(count), counting_time};
}

ClientSharedMapRequest NetworkWorker::WishFor(const Keyframe& view, double overlap, const Eigen::Vector3d& p_map) {
  // The server does not read the sketch here, and the uniform sampler's form of the view leaves it out.
  const ViewQuery query{.pose_frame = view.pose_frame,
                        .T_frame_camera = view.T_frame_camera,
                        .sampler = SamplerKind::kUniform,
                        .sketch = {}};
  return {.keyframe = view.number,
          .view = query,
          .oversharing = options_.oversharing,
          .overlap = overlap,
          .min_seen_by_others = options_.min_seen_by_others,
          .held_tiles = tiles_->Held(p_map, session_->cone_range_m + options_.look_ahead_m),
          .max_bytes = options_.max_shared_map_bytes,
          .look_ahead = {.distance_m = options_.look_ahead_m, .motion = MotionIn(view.pose_frame)}};
}

StatusOr<bool> NetworkWorker::Share(const Keyframe& view, double overlap, Patience patience) {
  const std::optional<Pose3> T_map_session = progress_.T_map_session();
  if (!T_map_session) return absl::FailedPreconditionError("the session is not aligned");
  tiles_->Forget(progress_.TakeChangedTiles());
  const Pose3 T_map_camera =
      view.pose_frame == PoseFrame::kMap ? view.T_frame_camera : *T_map_session * view.T_frame_camera;
  const ClientSharedMapRequest request = WishFor(view, overlap, T_map_camera.translation());
  const Stopwatch stopwatch;
  size_t num_early_tiles = 0;
  const auto use_early = [&](const ClientSharedMap& so_far) {
    if (num_early_tiles > 0) return;
    const auto map = tiles_->MapOf(so_far.tiles, *T_map_session, num_shared_maps_ + 1);
    if (map->points.size() < kMinEarlyPoints) return;
    num_early_tiles = so_far.tiles.size();
    ++num_shared_maps_;
    progress_.OnSharedMap(map->number);
    adapter_->TakeSharedMap(map);
  };
  MAPP_ASSIGN_OR_RETURN(ClientSharedMap received, client_.RequestSharedMap(session_->id, request, patience, use_early));
  progress_.RecordLatency(Step::kSharedMap, stopwatch.Elapsed());
  if (received.first_tile_after) progress_.RecordLatency(Step::kFirstSharedTile, *received.first_tile_after);
  if (received.is_own_map) return false;
  const bool over_budget = received.num_tiles_over_budget > 0;
  const SharedTiles::Taken taken = tiles_->Take(std::move(received), request.held_tiles);
  progress_.UpdateStats([&](ParticipantStats& stats) { stats.num_cached_tiles += taken.num_cached; });
  const auto map = tiles_->MapOf(taken.keys, *T_map_session, num_shared_maps_ + 1);
  tiles_->DropFarthest(T_map_camera.translation());
  if (map->points.empty()) {
    if (over_budget) {
      NoteError(progress_, absl::ResourceExhaustedError("max_shared_map_bytes: too few for the nearest tile"));
    }
    return false;
  }
  if (taken.keys.size() != num_early_tiles) {
    ++num_shared_maps_;
    // First the state: the tracking thread may report on the map as soon as it has it.
    if (num_early_tiles == 0) {
      progress_.OnSharedMap(map->number);
    } else {
      progress_.OnSharedMapWhole(map->number);
    }
    adapter_->TakeSharedMap(map);
  }
  if (options_.report_evidence) evidence_->UseMap(num_shared_maps_, taken.keys, *tiles_, *T_map_session);
  // After the device has them: a disk may be slow.
  if (const Status stored = tiles_->StoreNew(); !stored.ok()) NoteError(progress_, stored);
  return true;
}

Eigen::Vector3d NetworkWorker::MotionIn(PoseFrame frame) const {
  const Eigen::Vector3d motion_session = progress_.motion_session();
  const std::optional<Pose3> T_map_session = progress_.T_map_session();
  return frame == PoseFrame::kMap && T_map_session ? T_map_session->rotation() * motion_session : motion_session;
}

void NetworkWorker::Handle(const FailureJob& job) {
  // Algorithm 1 of the paper, an iteration of its loop at a time: whether the device localises on the map it gets here
  // is told by its next frames.
  if (!MayShare()) {
    LeaveSharedMap();
    return;
  }
  if (job.num_maps_tried >= options_.max_shared_map_tries) {
    ReportFailure(job);
    return;
  }
  Keyframe view;
  view.T_frame_camera = job.frame.T_session_camera;
  if (job.keyframe) view.number = job.keyframe->number;
  // One attempt: while the device waits for a map it neither localises nor maps. Without a server it had better map.
  const StatusOr<bool> shared = Share(view, 0, Patience::kOneAttempt);
  if (!shared.ok()) NoteError(progress_, shared.status());
  if (!shared.ok() || !*shared) LeaveSharedMap();
}

void NetworkWorker::ReportFailure(const FailureJob& job) {
  if (!job.keyframe) {
    LeaveSharedMap();
    return;
  }
  Keyframe keyframe = *job.keyframe;
  keyframe.session = session_->id;
  PlaceInMap(keyframe);
  progress_.UpdateStats([](ParticipantStats& stats) { ++stats.num_update_reports; });
  const Stopwatch stopwatch;
  const StatusOr<ClientUpdateVerdict> verdict =
      client_.ReportUpdate(session_->id, {EncodeKeyframe(keyframe)}, Patience::kOneAttempt);
  if (!verdict.ok()) NoteError(progress_, verdict.status());
  if (verdict.ok()) progress_.RecordLatency(Step::kUpdateReport, stopwatch.Elapsed());
  if (verdict.ok() && *verdict == ClientUpdateVerdict::kUpdating) progress_.AddEvidence(*job.keyframe, true);
  LeaveSharedMap();
}

void NetworkWorker::LeaveSharedMap() {
  adapter_->LeaveSharedMap();
  progress_.OnLeftSharedMap();
  evidence_->Conclude();
  NoteIfFailed(progress_, DeliverEvidence(Patience::kOneAttempt));
}

void NetworkWorker::PlaceInMap(Keyframe& keyframe) const {
  const std::optional<Pose3> T_map_session = progress_.T_map_session();
  if (!T_map_session) return;
  keyframe.pose_frame = PoseFrame::kMap;
  keyframe.T_frame_camera = *T_map_session * keyframe.T_frame_camera;
}

}  // namespace mapp
