#include "server/service/registrar.h"

#include "server/service/alignment_consensus.h"
#include "server/service/fragment_index.h"
#include "server/service/loop_closer.h"
#include "server/service/map_scale.h"
#include "server/service/merger.h"
#include "server/service/placement_check.h"
#include "server/service/placement_refiner.h"
#include "server/service/serial_worker.h"
#include "server/service/session_events.h"
#include "server/service/session_guard.h"
#include "server/service/session_view.h"
#include "server/service/step_times.h"
#include "server/service/stored_places.h"
#include "server/service/way_check.h"

#include <algorithm>
#include <atomic>
#include <future>
#include <numbers>
#include <set>
#include <unordered_map>

namespace mapp {
namespace {

/// Keyframes that may wait. Beyond, a map's index catches up from the store instead.
constexpr size_t kMaxWaitingFrames = 4096;
/// Earlier keyframes of a fragment looked at again when the registrar meets it for the first time after a start.
constexpr size_t kKeyframesRevisited = 6;
/// Of a merged fragment, each third frame is looked at as one that joins the map: neighbours look alike.
constexpr size_t kJoinedStep = 3;
/// Fragments tried again for one frame that joins the map ...
constexpr size_t kMaxRecalled = 2;
/// ... and where a keyframe of the fragment finds its place, so many before and after it are asked too.
constexpr size_t kNeighborsAsked = 2;

struct Task {
  enum class Kind { kFrame, kCheckedFrame, kClosed, kMapCame, kMapGone, kQuarantined, kReleased, kAlone };
  Kind kind = Kind::kFrame;
  MapId map;
  SessionId session;
  FrameId frame;                                                 ///< of the first two kinds
  std::vector<FrameId> retired;                                  ///< of kQuarantined
  std::shared_ptr<std::packaged_task<Status()>> work = nullptr;  ///< of kAlone
};

/// Doubtful keyframes of one session that differ by less than both of these are one view.
constexpr double kSameViewM = 0.7;
constexpr double kSameViewRad = 20.0 * std::numbers::pi / 180.0;

/// What is known of one map; all of it can be had again from the store.
struct MapState {
  StoredPlaces places;
  std::unordered_map<SessionId, PlacementWords> fragments;
  FragmentIndex unmerged;                             ///< keyframes of fragments
  std::unordered_map<SessionId, Pose3> last_checked;  ///< T_map_camera of the last doubtful keyframe looked at
};

}  // namespace

struct Registrar::Impl {
  Impl(MapStore& map_store, TileCache& tile_cache, SessionEvents& session_events, const RegistrarOptions& opts)
      : store(map_store),
        tiles(tile_cache),
        events(session_events),
        options(opts),
        refiner(store, tiles, events, options),
        loop_closer(store, tiles, events, options),
        worker(kMaxWaitingFrames, [this](const Task& task) { Run(task); }) {}

  void Run(const Task& task);
  /// Tiles and indices share one limit: of the frames indexed, and those about to be.
  void MakeRoomForIndices(size_t num_frames_more = 0);
  Status Process(const Task& task);
  Status ProcessFragmentFrame(MapReader& reader, const FrameRecord& frame, MapState& state);
  /// Asks one keyframe where its session lies and adds its word to `consensus`.
  StatusOr<AlignmentTried> TryKeyframe(MapReader& reader, const FrameView& view, const PlaceIndex& index,
                                       AlignmentConsensus& consensus) const;
  StatusOr<AlignmentConsensus*> ConsensusOf(MapReader& reader, const FrameRecord& newest, MapState& state) const;
  /// Merges the fragment of `frame` if its keyframes have agreed on a place and the way around it does not contradict
  /// it.
  Status MergeIfDecided(MapReader& reader, const FrameRecord& frame, AlignmentConsensus& consensus, MapState& state);
  Status Merge(MapReader& reader, const FrameRecord& frame, const Sim3& S_map_session, MapState& state);
  /// Tries the fragments again that have a keyframe like this frame of the map.
  Status RecallFragments(MapReader& reader, const FrameRecord& frame, MapState& state);
  /// A close look at a doubtful keyframe, unless it shows what the one before it did.
  Status CheckDoubtful(MapReader& reader, const FrameRecord& frame, MapState& state);
  /// Nothing more is to come that what is remembered of the session would serve.
  void ForgetClosed(const Task& task);
  void QueueClosed(MapId map, SessionId session);
  void ForgetQuarantined(const Task& task);
  Status TakeUpReleased(const Task& task);
  Status TakeUpMap(MapId map);
  Status TryAgain(MapReader& reader, const FrameView& view, MapState& state);
  /// Where a loop is closed, what was said of the map as it was is forgotten.
  Status CloseLoops(MapReader& reader, const FrameRecord& frame, MapState& state);

  /// The map's state, its index filled from the store when that is not up to date.
  StatusOr<MapState*> StateOf(MapReader& reader, MapId map);
  /// Those of the map to its index, those of fragments to that of fragments.
  static Status AddFrames(MapReader& reader, MapId map, std::optional<SessionId> session, MapState& state);

  MapStore& store;
  TileCache& tiles;
  SessionEvents& events;
  const RegistrarOptions options;

  std::atomic<bool> stopping = false;
  // Of the worker's thread alone.
  PlacementRefiner refiner;
  LoopCloser loop_closer;
  std::unordered_map<MapId, MapState> maps;

  Mutex mutex;
  /// Maps some of whose frames never reached the queue.
  std::set<MapId> behind ABSL_GUARDED_BY(mutex);

  SerialWorker<Task> worker;  ///< last: its thread uses all of the above
};

Status Registrar::Impl::AddFrames(MapReader& reader, MapId map, std::optional<SessionId> session, MapState& state) {
  MAPP_ASSIGN_OR_RETURN(const std::vector<FrameRecord> frames, reader.ListFrames(map, session));
  for (const FrameRecord& frame : frames) {
    if (frame.in_map) {
      MAPP_RETURN_IF_ERROR(state.places.Add(reader, frame.id));
      continue;
    }
    MAPP_ASSIGN_OR_RETURN(const SessionRecord record, reader.GetSession(frame.session));
    // Frames left out of an aligned session are nobody's fragment.
    if (record.T_map_session || record.IsQuarantined()) continue;
    MAPP_ASSIGN_OR_RETURN(const std::vector<OrbDescriptor> descriptors, LoadDescriptors(reader, frame.id));
    state.unmerged.Add(frame.session, frame.id, descriptors);
  }
  return absl::OkStatus();
}

StatusOr<MapState*> Registrar::Impl::StateOf(MapReader& reader, MapId map) {
  MAPP_ASSIGN_OR_RETURN(const MapRecord record, reader.GetMap(map));
  bool must_catch_up = false;
  {
    const MutexLock lock(mutex);
    must_catch_up = behind.erase(map) > 0;
  }
  const auto on_trouble = [this](const Status& trouble) {
    if (!absl::IsNotFound(trouble) && options.on_error) options.on_error(SessionId(), trouble);
  };
  const auto [state, is_new] = maps.try_emplace(map, MapState{StoredPlaces(store, map, on_trouble), {}, {}, {}});
  if (is_new || must_catch_up) {
    if (is_new) MakeRoomForIndices(static_cast<size_t>(record.num_frames));
    Status status = is_new ? state->second.places.Load(reader) : absl::OkStatus();
    if (status.ok()) status = AddFrames(reader, map, std::nullopt, state->second);
    if (!status.ok()) {
      // Half an index would look like a whole one the next time.
      maps.erase(state);
      return status;
    }
  }
  return &state->second;
}

StatusOr<AlignmentTried> Registrar::Impl::TryKeyframe(MapReader& reader, const FrameView& view, const PlaceIndex& index,
                                                      AlignmentConsensus& consensus) const {
  std::vector<FrameId> candidates;
  for (const PlaceIndex::Candidate& candidate :
       index.Query(view.Descriptors(), static_cast<size_t>(options.max_candidates))) {
    candidates.emplace_back(candidate.frame);
  }
  AlignmentTried tried{.keyframe = view.record.number, .num_candidates = static_cast<uint32_t>(candidates.size())};
  if (candidates.empty()) return tried;
  MAPP_ASSIGN_OR_RETURN(VerificationResult result,
                        VerifyCandidates(reader, view, candidates, {.session = view.record.session}, options));
  tried.num_inliers = static_cast<uint32_t>(result.best_inliers);
  if (result.alignment) tried.num_consistent = static_cast<uint32_t>(consensus.Add(std::move(*result.alignment)));
  return tried;
}

/// What the fragment's keyframes have said so far. Met for the first time after a start, the fragment's last keyframes
/// before `newest` are asked again: what they said was only in memory.
StatusOr<AlignmentConsensus*> Registrar::Impl::ConsensusOf(MapReader& reader, const FrameRecord& newest,
                                                           MapState& state) const {
  MAPP_ASSIGN_OR_RETURN(const double map_unit, UnitOf(reader, newest.map));
  auto [fragment, is_new] = state.fragments.try_emplace(newest.session, map_unit, AlignmentConsensus(options));
  if (fragment->second.map_unit != map_unit) {
    fragment->second = {map_unit, AlignmentConsensus(options)};
    is_new = true;
  }
  AlignmentConsensus* const consensus = &fragment->second.consensus;
  if (!is_new) return consensus;
  MAPP_ASSIGN_OR_RETURN(std::vector<FrameRecord> earlier, reader.ListFrames(newest.map, newest.session));
  std::erase_if(earlier, [&](const FrameRecord& frame) { return frame.id >= newest.id; });
  const size_t first = earlier.size() > kKeyframesRevisited ? earlier.size() - kKeyframesRevisited : 0;
  for (size_t i = first; i < earlier.size(); ++i) {
    MAPP_ASSIGN_OR_RETURN(const FrameView view, LoadFrame(reader, earlier[i].id));
    MAPP_RETURN_IF_ERROR(TryKeyframe(reader, view, state.places.index(), *consensus).status());
  }
  return consensus;
}

Status Registrar::Impl::ProcessFragmentFrame(MapReader& reader, const FrameRecord& frame, MapState& state) {
  MAPP_ASSIGN_OR_RETURN(const SessionRecord session, reader.GetSession(frame.session));
  if (session.T_map_session) return absl::OkStatus();  // left out of the map for good
  if (session.IsQuarantined()) {
    events.Publish(frame.session, AlignmentTried{.keyframe = frame.number});
    return absl::OkStatus();
  }
  const Stopwatch stopwatch;
  MAPP_ASSIGN_OR_RETURN(const FrameView view, LoadFrame(reader, frame.id));
  MAPP_ASSIGN_OR_RETURN(AlignmentConsensus* const consensus, ConsensusOf(reader, frame, state));
  MAPP_ASSIGN_OR_RETURN(const AlignmentTried tried, TryKeyframe(reader, view, state.places.index(), *consensus));
  state.unmerged.Add(frame.session, frame.id, view.Descriptors());
  const Status merged = MergeIfDecided(reader, frame, *consensus, state);
  if (options.step_times != nullptr) options.step_times->Add(ServiceStep::kAlignment, stopwatch.Elapsed());
  // After the merge: who waits for the comparison of a keyframe then knows what came of it.
  events.Publish(frame.session, tried);
  return merged;
}

Status Registrar::Impl::MergeIfDecided(MapReader& reader, const FrameRecord& frame, AlignmentConsensus& consensus,
                                       MapState& state) {
  const std::optional<Sim3> S_map_session = consensus.Decide();
  if (!S_map_session) return absl::OkStatus();
  MAPP_ASSIGN_OR_RETURN(const ViewAgreement way,
                        CompareWayWithMap(reader, frame, *S_map_session, {.session = frame.session}));
  if (Tolerates(options, way)) return Merge(reader, frame, *S_map_session, state);
  consensus.Forget();
  return absl::OkStatus();
}

Status Registrar::Impl::Merge(MapReader& reader, const FrameRecord& frame, const Sim3& S_map_session, MapState& state) {
  MAPP_ASSIGN_OR_RETURN(const PointFusions fusions, FindFusions(reader, frame.session, S_map_session));
  const Status merge_status = MergeFragment(store, tiles, events, CallContext{}, frame.session,
                                            {S_map_session, state.fragments.at(frame.session).map_unit}, fusions);
  // The map has another unit of length by now: its keyframes have to be asked again.
  if (absl::IsAborted(merge_status)) return absl::OkStatus();
  MAPP_RETURN_IF_ERROR(merge_status);
  MAPP_ASSIGN_OR_RETURN(const std::unique_ptr<MapReader> merged, store.Read());
  MAPP_ASSIGN_OR_RETURN(const SessionRecord session, merged->GetSession(frame.session));
  if (!MeasuresDepth(session.sensor)) refiner.Begin(session.id, std::move(state.fragments.at(session.id)));
  state.fragments.erase(frame.session);
  state.unmerged.Remove(frame.session);
  MAPP_RETURN_IF_ERROR(AddFrames(*merged, frame.map, frame.session, state));
  // Other fragments may have been where this one was, and its own way may lead back to where the map was before.
  MAPP_ASSIGN_OR_RETURN(const std::vector<FrameRecord> frames, merged->ListFrames(frame.map, frame.session));
  for (size_t i = 0; i < frames.size(); i += kJoinedStep) {
    worker.Push({.map = frame.map, .session = frame.session, .frame = frames[i].id, .retired = {}});
  }
  if (session.closed_ns) QueueClosed(frame.map, session.id);
  return absl::OkStatus();
}

void Registrar::Impl::QueueClosed(MapId map, SessionId session) {
  if (worker.Push({.kind = Task::Kind::kClosed, .map = map, .session = session, .frame = {}, .retired = {}})) return;
  if (options.on_optimization_due) options.on_optimization_due(session);
}

Status Registrar::Impl::RecallFragments(MapReader& reader, const FrameRecord& frame, MapState& state) {
  if (state.unmerged.empty()) return absl::OkStatus();
  MAPP_ASSIGN_OR_RETURN(const std::vector<OrbDescriptor> descriptors, LoadDescriptors(reader, frame.id));
  for (const FrameId recalled : state.unmerged.LookingLike(descriptors, kMaxRecalled)) {
    // As the map stands now: the one before may have merged, and given the map another unit.
    MAPP_ASSIGN_OR_RETURN(const std::unique_ptr<MapReader> now, store.Read());
    MAPP_ASSIGN_OR_RETURN(const FrameView own, LoadFrame(*now, recalled));
    if (own.record.in_map) continue;
    // Something always looks most alike: only what also fits this one frame is worth the whole comparison.
    const FrameId joined[] = {frame.id};
    MAPP_ASSIGN_OR_RETURN(const VerificationResult fit,
                          VerifyCandidates(*now, own, joined, {.session = own.record.session}, options));
    if (fit.best_inliers < options.min_inliers) continue;
    MAPP_RETURN_IF_ERROR(TryAgain(*now, own, state));
  }
  return absl::OkStatus();
}

Status Registrar::Impl::TryAgain(MapReader& reader, const FrameView& view, MapState& state) {
  MAPP_ASSIGN_OR_RETURN(AlignmentConsensus* const consensus, ConsensusOf(reader, view.record, state));
  MAPP_ASSIGN_OR_RETURN(const AlignmentTried tried, TryKeyframe(reader, view, state.places.index(), *consensus));
  if (tried.num_consistent == 0) return absl::OkStatus();
  MAPP_ASSIGN_OR_RETURN(const std::vector<FrameRecord> frames, reader.ListFrames(view.record.map, view.record.session));
  const auto at =
      std::find_if(frames.begin(), frames.end(), [&](const FrameRecord& f) { return f.id == view.record.id; });
  const auto idx = static_cast<size_t>(at - frames.begin());
  for (size_t i = idx - std::min(idx, kNeighborsAsked); i < std::min(idx + kNeighborsAsked + 1, frames.size()); ++i) {
    if (i == idx) continue;
    MAPP_ASSIGN_OR_RETURN(const FrameView neighbor, LoadFrame(reader, frames[i].id));
    MAPP_RETURN_IF_ERROR(TryKeyframe(reader, neighbor, state.places.index(), *consensus).status());
  }
  return MergeIfDecided(reader, view.record, *consensus, state);
}

Status Registrar::Impl::CheckDoubtful(MapReader& reader, const FrameRecord& frame, MapState& state) {
  const auto [last, is_first] = state.last_checked.try_emplace(frame.session, frame.T_frame_camera);
  if (!is_first && Distance(last->second, frame.T_frame_camera) < kSameViewM &&
      RotationAngle(last->second, frame.T_frame_camera) < kSameViewRad) {
    return absl::OkStatus();
  }
  last->second = frame.T_frame_camera;
  MAPP_ASSIGN_OR_RETURN(const FrameView view, LoadFrame(reader, frame.id));
  MAPP_ASSIGN_OR_RETURN(const KeyframeEvidence evidence, CheckPlacement(reader, view, state.places.index(), options));
  MAPP_ASSIGN_OR_RETURN(const SessionRecord session, reader.GetSession(frame.session));
  return options.guard->NoteLate(session, frame.number, evidence);
}

void Registrar::Impl::ForgetClosed(const Task& task) {
  refiner.Forget(task.session);
  loop_closer.Forget(task.session);
  const auto state = maps.find(task.map);
  if (state != maps.end()) state->second.last_checked.erase(task.session);
}

void Registrar::Impl::ForgetQuarantined(const Task& task) {
  refiner.Forget(task.session);
  loop_closer.Forget(task.session);
  const auto state = maps.find(task.map);
  if (state == maps.end()) return;
  state->second.fragments.erase(task.session);
  state->second.last_checked.erase(task.session);
  state->second.unmerged.Remove(task.session);
  for (const FrameId frame : task.retired) {
    state->second.places.Remove(frame);
  }
}

Status Registrar::Impl::TakeUpReleased(const Task& task) {
  MAPP_ASSIGN_OR_RETURN(const std::unique_ptr<MapReader> reader, store.Read());
  MAPP_ASSIGN_OR_RETURN(const std::vector<FrameRecord> frames, reader->ListFrames(task.map, task.session));
  for (const FrameRecord& frame : frames) {
    if (!frame.in_map) worker.Push({.map = task.map, .session = task.session, .frame = frame.id, .retired = {}});
  }
  return absl::OkStatus();
}

Status Registrar::Impl::TakeUpMap(MapId map) {
  MAPP_ASSIGN_OR_RETURN(const std::unique_ptr<MapReader> reader, store.Read());
  MAPP_ASSIGN_OR_RETURN(MapState* const state, StateOf(*reader, map));
  state->places.Store();
  return absl::OkStatus();
}

Status Registrar::Impl::CloseLoops(MapReader& reader, const FrameRecord& frame, MapState& state) {
  CallContext context;
  context.is_cancelled = [this] { return stopping.load(); };
  const StatusOr<bool> closed = loop_closer.OnFrame(context, reader, frame, state.places.index());
  if (!closed.ok()) {
    // Of frames that look alike one may be broken: the others' work goes on.
    if (!stopping && options.on_error) options.on_error(frame.session, closed.status());
    return absl::OkStatus();
  }
  if (!*closed) return absl::OkStatus();
  state.fragments.clear();
  state.last_checked.clear();
  refiner.ForgetAll();
  return absl::OkStatus();
}

Status Registrar::Impl::Process(const Task& task) {
  MAPP_ASSIGN_OR_RETURN(const std::unique_ptr<MapReader> reader, store.Read());
  // The session may have merged since the frame was stored, or been quarantined: the store knows.
  MAPP_ASSIGN_OR_RETURN(const FrameRecord frame, reader->GetFrame(task.frame));
  MAPP_ASSIGN_OR_RETURN(MapState* const state, StateOf(*reader, frame.map));
  if (!frame.in_map) return ProcessFragmentFrame(*reader, frame, *state);
  MAPP_RETURN_IF_ERROR(state->places.Add(*reader, frame.id));
  MAPP_RETURN_IF_ERROR(refiner.OnFrame(*reader, frame, state->places.index()));
  MAPP_RETURN_IF_ERROR(CloseLoops(*reader, frame, *state));
  if (task.kind == Task::Kind::kCheckedFrame && options.guard != nullptr) {
    MAPP_RETURN_IF_ERROR(CheckDoubtful(*reader, frame, *state));
  }
  return RecallFragments(*reader, frame, *state);
}

void Registrar::Impl::MakeRoomForIndices(size_t num_frames_more) {
  size_t num_frames = num_frames_more;
  for (const auto& [map, state] : maps) num_frames += state.places.index().num_frames();
  tiles.MakeRoomFor(num_frames * PlaceIndex::kBytesAFrame);
}

void Registrar::Impl::Run(const Task& task) {
  Status status;
  switch (task.kind) {
    case Task::Kind::kClosed:
      ForgetClosed(task);
      if (options.on_optimization_due) options.on_optimization_due(task.session);
      return;
    case Task::Kind::kMapCame:
      status = TakeUpMap(task.map);
      break;
    case Task::Kind::kMapGone:
      maps.erase(task.map);
      refiner.ForgetAll();
      loop_closer.ForgetAll();
      return;
    case Task::Kind::kQuarantined:
      ForgetQuarantined(task);
      return;
    case Task::Kind::kAlone:
      maps.erase(task.map);
      (*task.work)();
      return;
    case Task::Kind::kReleased:
      status = TakeUpReleased(task);
      break;
    case Task::Kind::kFrame:
    case Task::Kind::kCheckedFrame:
      status = Process(task);
      break;
  }
  MakeRoomForIndices();
  if (!status.ok() && !absl::IsNotFound(status) && options.on_error) options.on_error(task.session, status);
}

Registrar::Registrar(MapStore& store, TileCache& tiles, SessionEvents& events, const RegistrarOptions& options)
    : impl_(std::make_unique<Impl>(store, tiles, events, options)) {}

Registrar::~Registrar() { Shutdown(); }

void Registrar::OnKeyframeStored(MapId map, SessionId session, FrameId frame, bool in_map, bool doubtful) {
  const Task::Kind kind = doubtful ? Task::Kind::kCheckedFrame : Task::Kind::kFrame;
  if (impl_->worker.Push({.kind = kind, .map = map, .session = session, .frame = frame, .retired = {}})) return;
  // A fragment's keyframe that finds the queue full goes unasked; a later one of its session will do. A frame of the
  // map is read from the store when the index is used next.
  if (!in_map) return;
  const MutexLock lock(impl_->mutex);
  impl_->behind.insert(map);
}

void Registrar::OnSessionClosed(MapId map, SessionId session) { impl_->QueueClosed(map, session); }

void Registrar::OnMapImported(MapId map) {
  impl_->worker.Push({.kind = Task::Kind::kMapCame, .map = map, .session = {}, .frame = {}, .retired = {}});
}

void Registrar::OnMapDeleted(MapId map) {
  impl_->worker.Push({.kind = Task::Kind::kMapGone, .map = map, .session = {}, .frame = {}, .retired = {}});
}

void Registrar::OnSessionQuarantined(MapId map, SessionId session, const std::vector<FrameId>& retired) {
  impl_->worker.Push(
      {.kind = Task::Kind::kQuarantined, .map = map, .session = session, .frame = {}, .retired = retired});
}

void Registrar::OnSessionReleased(MapId map, SessionId session) {
  impl_->worker.Push({.kind = Task::Kind::kReleased, .map = map, .session = session, .frame = {}, .retired = {}});
}

Status Registrar::RunAlone(MapId map, const std::function<Status()>& work) {
  auto task = std::make_shared<std::packaged_task<Status()>>(work);
  std::future<Status> done = task->get_future();
  const Status busy = absl::UnavailableError("the registrar is busy or stopping: try again");
  Task alone{
      .kind = Task::Kind::kAlone, .map = map, .session = {}, .frame = {}, .retired = {}, .work = std::move(task)};
  if (!impl_->worker.Push(std::move(alone))) return busy;
  try {
    return done.get();
  } catch (const std::future_error&) {
    return busy;  // dropped with the queue, which the task alone still held
  }
}

void Registrar::WaitUntilIdle() { impl_->worker.WaitUntilIdle(); }

void Registrar::Shutdown() {
  impl_->stopping = true;
  impl_->worker.Stop();
  for (auto& [map, state] : impl_->maps) state.places.Store();
}

}  // namespace mapp
