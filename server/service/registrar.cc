#include "server/service/registrar.h"

#include "server/service/placement_check.h"
#include "server/service/registrar_impl.h"
#include "server/service/session_guard.h"
#include "server/service/session_view.h"

#include <algorithm>
#include <numbers>
#include <utility>

namespace mapp {
namespace {

/// Doubtful keyframes of one session that differ by less than both of these are one view.
constexpr double kSameViewM = 0.7;
constexpr double kSameViewRad = 20.0 * std::numbers::pi / 180.0;

}  // namespace

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

StatusOr<Registrar::Impl::MapState*> Registrar::Impl::StateOf(MapReader& reader, MapId map) {
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

void Registrar::Impl::QueueClosed(MapId map, SessionId session) {
  if (worker.Push({.kind = Task::Kind::kClosed, .map = map, .session = session, .frame = {}, .retired = {}})) return;
  if (options.on_optimization_due) options.on_optimization_due(session);
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
  const Impl::Task::Kind kind = doubtful ? Impl::Task::Kind::kCheckedFrame : Impl::Task::Kind::kFrame;
  if (impl_->worker.Push({.kind = kind, .map = map, .session = session, .frame = frame, .retired = {}})) return;
  // A fragment's keyframe that finds the queue full goes unasked; a later one of its session will do. A frame of the
  // map is read from the store when the index is used next.
  if (!in_map) return;
  const MutexLock lock(impl_->mutex);
  impl_->behind.insert(map);
}

void Registrar::OnSessionClosed(MapId map, SessionId session) { impl_->QueueClosed(map, session); }

void Registrar::OnMapImported(MapId map) {
  impl_->worker.Push({.kind = Impl::Task::Kind::kMapCame, .map = map, .session = {}, .frame = {}, .retired = {}});
}

void Registrar::OnMapDeleted(MapId map) {
  impl_->worker.Push({.kind = Impl::Task::Kind::kMapGone, .map = map, .session = {}, .frame = {}, .retired = {}});
}

void Registrar::OnSessionQuarantined(MapId map, SessionId session, const std::vector<FrameId>& retired) {
  impl_->worker.Push(
      {.kind = Impl::Task::Kind::kQuarantined, .map = map, .session = session, .frame = {}, .retired = retired});
}

void Registrar::OnSessionReleased(MapId map, SessionId session) {
  impl_->worker.Push({.kind = Impl::Task::Kind::kReleased, .map = map, .session = session, .frame = {}, .retired = {}});
}

Status Registrar::RunAlone(MapId map, const std::function<Status()>& work) {
  auto task = std::make_shared<std::packaged_task<Status()>>(work);
  std::future<Status> done = task->get_future();
  const Status busy = absl::UnavailableError("the registrar is busy or stopping: try again");
  Impl::Task alone{
      .kind = Impl::Task::Kind::kAlone, .map = map, .session = {}, .frame = {}, .retired = {}, .work = std::move(task)};
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
