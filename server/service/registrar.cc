#include "server/service/registrar.h"

#include "server/service/alignment_consensus.h"
#include "server/service/merger.h"
#include "server/service/serial_worker.h"
#include "server/service/session_events.h"
#include "server/service/step_times.h"
#include "server/service/way_check.h"
#include "vision/place_index.h"

#include <algorithm>
#include <set>
#include <unordered_map>
#include <unordered_set>

namespace mapp {
namespace {

/// Keyframes that may wait. Beyond, a map's index catches up from the store instead.
constexpr size_t kMaxWaitingFrames = 4096;
/// Earlier keyframes of a fragment looked at again when the registrar meets it for the first time after a start.
constexpr size_t kKeyframesRevisited = 6;

struct Task {
  MapId map;
  /// Absent: the map is gone, forget it.
  std::optional<FrameId> frame;
  SessionId session;
};

/// What is known of one map; all of it can be had again from the store.
struct MapState {
  PlaceIndex index{PlaceIndex::Options{}};
  std::unordered_set<FrameId> indexed_frames;
  std::unordered_map<SessionId, AlignmentConsensus> fragments;
};

}  // namespace

struct Registrar::Impl {
  Impl(MapStore& map_store, TileCache& tile_cache, SessionEvents& session_events, const RegistrarOptions& opts)
      : store(map_store),
        tiles(tile_cache),
        events(session_events),
        options(opts),
        worker(kMaxWaitingFrames, [this](const Task& task) { Run(task); }) {}

  void Run(const Task& task);
  Status Process(const Task& task);
  Status ProcessFragmentFrame(MapReader& reader, const FrameRecord& frame, MapState& state);
  /// Asks one keyframe where its session lies and adds its word to `consensus`.
  StatusOr<AlignmentTried> TryKeyframe(MapReader& reader, const FrameRecord& frame, const PlaceIndex& index,
                                       AlignmentConsensus& consensus) const;
  StatusOr<AlignmentConsensus*> ConsensusOf(MapReader& reader, const FrameRecord& newest, MapState& state) const;
  Status Merge(MapReader& reader, const FrameRecord& frame, const Pose3& T_map_session, MapState& state);

  /// The map's state, its index filled from the store when that is not up to date.
  StatusOr<MapState*> StateOf(MapReader& reader, MapId map);
  static Status AddToIndex(MapReader& reader, FrameId frame, MapState& state);
  static Status AddFrames(MapReader& reader, MapId map, std::optional<SessionId> session, MapState& state);

  MapStore& store;
  TileCache& tiles;
  SessionEvents& events;
  const RegistrarOptions options;

  std::unordered_map<MapId, MapState> maps;  ///< of the worker's thread alone

  Mutex mutex;
  /// Maps some of whose frames never reached the queue.
  std::set<MapId> behind ABSL_GUARDED_BY(mutex);

  SerialWorker<Task> worker;  ///< last: its thread uses all of the above
};

Status Registrar::Impl::AddToIndex(MapReader& reader, FrameId frame, MapState& state) {
  if (state.indexed_frames.contains(frame)) return absl::OkStatus();
  MAPP_ASSIGN_OR_RETURN(const FrameView view, LoadFrame(reader, frame));
  state.index.Add(frame.value(), view.Descriptors());
  state.indexed_frames.insert(frame);
  return absl::OkStatus();
}

Status Registrar::Impl::AddFrames(MapReader& reader, MapId map, std::optional<SessionId> session, MapState& state) {
  MAPP_ASSIGN_OR_RETURN(const std::vector<FrameRecord> frames, reader.ListFrames(map, session));
  for (const FrameRecord& frame : frames) {
    if (frame.in_map) MAPP_RETURN_IF_ERROR(AddToIndex(reader, frame.id, state));
  }
  return absl::OkStatus();
}

StatusOr<MapState*> Registrar::Impl::StateOf(MapReader& reader, MapId map) {
  bool must_catch_up = false;
  {
    const MutexLock lock(mutex);
    must_catch_up = behind.erase(map) > 0;
  }
  const auto [state, is_new] = maps.try_emplace(map);
  if (is_new || must_catch_up) {
    const Status status = AddFrames(reader, map, std::nullopt, state->second);
    if (!status.ok()) {
      // Half an index would look like a whole one the next time.
      maps.erase(state);
      return status;
    }
  }
  return &state->second;
}

StatusOr<AlignmentTried> Registrar::Impl::TryKeyframe(MapReader& reader, const FrameRecord& frame,
                                                      const PlaceIndex& index, AlignmentConsensus& consensus) const {
  MAPP_ASSIGN_OR_RETURN(const FrameView view, LoadFrame(reader, frame.id));
  std::vector<FrameId> candidates;
  for (const PlaceIndex::Candidate& candidate :
       index.Query(view.Descriptors(), static_cast<size_t>(options.max_candidates))) {
    candidates.emplace_back(candidate.frame);
  }
  AlignmentTried tried{.keyframe = frame.number, .num_candidates = static_cast<uint32_t>(candidates.size())};
  if (candidates.empty()) return tried;
  MAPP_ASSIGN_OR_RETURN(VerificationResult result, VerifyCandidates(reader, view, candidates, options));
  tried.num_inliers = static_cast<uint32_t>(result.best_inliers);
  if (result.alignment) tried.num_consistent = static_cast<uint32_t>(consensus.Add(std::move(*result.alignment)));
  return tried;
}

/// What the fragment's keyframes have said so far. Met for the first time after a start, the fragment's last keyframes
/// before `newest` are asked again: what they said was only in memory.
StatusOr<AlignmentConsensus*> Registrar::Impl::ConsensusOf(MapReader& reader, const FrameRecord& newest,
                                                           MapState& state) const {
  const auto [fragment, is_new] = state.fragments.try_emplace(newest.session, options);
  AlignmentConsensus* const consensus = &fragment->second;
  if (!is_new) return consensus;
  MAPP_ASSIGN_OR_RETURN(std::vector<FrameRecord> earlier, reader.ListFrames(newest.map, newest.session));
  std::erase_if(earlier, [&](const FrameRecord& frame) { return frame.id >= newest.id; });
  const size_t first = earlier.size() > kKeyframesRevisited ? earlier.size() - kKeyframesRevisited : 0;
  for (size_t i = first; i < earlier.size(); ++i) {
    MAPP_RETURN_IF_ERROR(TryKeyframe(reader, earlier[i], state.index, *consensus).status());
  }
  return consensus;
}

Status Registrar::Impl::ProcessFragmentFrame(MapReader& reader, const FrameRecord& frame, MapState& state) {
  MAPP_ASSIGN_OR_RETURN(const SessionRecord session, reader.GetSession(frame.session));
  if (session.sensor == SensorKind::kMono) {
    events.Publish(frame.session, AlignmentTried{.keyframe = frame.number});
    return absl::OkStatus();
  }
  const Stopwatch stopwatch;
  MAPP_ASSIGN_OR_RETURN(AlignmentConsensus* const consensus, ConsensusOf(reader, frame, state));
  MAPP_ASSIGN_OR_RETURN(const AlignmentTried tried, TryKeyframe(reader, frame, state.index, *consensus));
  Status merged;
  if (const std::optional<Pose3> T_map_session = consensus->Decide()) {
    MAPP_ASSIGN_OR_RETURN(const ViewAgreement way, CompareWayWithMap(reader, frame, *T_map_session));
    if (Tolerates(options, way)) {
      merged = Merge(reader, frame, *T_map_session, state);
    } else {
      consensus->Forget();
    }
  }
  if (options.step_times != nullptr) options.step_times->Add(ServiceStep::kAlignment, stopwatch.Elapsed());
  // After the merge: who waits for the comparison of a keyframe then knows what came of it.
  events.Publish(frame.session, tried);
  return merged;
}

Status Registrar::Impl::Merge(MapReader& reader, const FrameRecord& frame, const Pose3& T_map_session,
                              MapState& state) {
  MAPP_ASSIGN_OR_RETURN(const PointFusions fusions, FindFusions(reader, frame.session, T_map_session));
  MAPP_RETURN_IF_ERROR(MergeFragment(store, tiles, events, CallContext{}, frame.session, T_map_session, fusions));
  state.fragments.erase(frame.session);
  MAPP_ASSIGN_OR_RETURN(const std::unique_ptr<MapReader> merged, store.Read());
  return AddFrames(*merged, frame.map, frame.session, state);
}

Status Registrar::Impl::Process(const Task& task) {
  MAPP_ASSIGN_OR_RETURN(const std::unique_ptr<MapReader> reader, store.Read());
  // The session may have merged since the frame was stored: the store knows.
  MAPP_ASSIGN_OR_RETURN(const FrameRecord frame, reader->GetFrame(*task.frame));
  MAPP_ASSIGN_OR_RETURN(MapState* const state, StateOf(*reader, frame.map));
  return frame.in_map ? AddToIndex(*reader, frame.id, *state) : ProcessFragmentFrame(*reader, frame, *state);
}

void Registrar::Impl::Run(const Task& task) {
  if (!task.frame) {
    maps.erase(task.map);
    return;
  }
  const Status status = Process(task);
  if (!status.ok() && !absl::IsNotFound(status) && options.on_error) options.on_error(task.session, status);
}

Registrar::Registrar(MapStore& store, TileCache& tiles, SessionEvents& events, const RegistrarOptions& options)
    : impl_(std::make_unique<Impl>(store, tiles, events, options)) {}

Registrar::~Registrar() { Shutdown(); }

void Registrar::OnKeyframeStored(MapId map, SessionId session, FrameId frame, bool in_map) {
  if (impl_->worker.Push({.map = map, .frame = frame, .session = session})) return;
  // A fragment's keyframe that finds the queue full goes unasked; a later one of its session will do. A frame of the
  // map is read from the store when the index is used next.
  if (!in_map) return;
  const MutexLock lock(impl_->mutex);
  impl_->behind.insert(map);
}

void Registrar::OnMapDeleted(MapId map) { impl_->worker.Push({.map = map, .frame = std::nullopt, .session = {}}); }

void Registrar::Shutdown() { impl_->worker.Stop(); }

}  // namespace mapp
