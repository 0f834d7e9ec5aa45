#include "storage/memory/change.h"

#include "storage/checks.h"

#include <algorithm>
#include <set>
#include <vector>

namespace mapp::memory {
namespace {

/// What UpdateSession writes.
void CopyState(const SessionRecord& from, SessionRecord* to) {
  to->closed_ns = from.closed_ns;
  to->T_map_session = from.T_map_session;
  to->scale_map_session = from.scale_map_session;
  to->aligned_at_keyframe = from.aligned_at_keyframe;
  to->optimized = from.optimized;
  to->quarantine = from.quarantine;
}

std::set<CameraId> CamerasOf(const MapState& map) {
  std::set<CameraId> cameras;
  map.sessions.ForEach([&](SessionId, const SessionRecord& session) { cameras.insert(session.camera); });
  return cameras;
}

}  // namespace

Contents Change::Finish() {
  for (auto& [map, draft] : drafts_) {
    MapState& state = *draft.state;
    const Revision revision = state.record.revision;
    if (draft.has_revision) {
      state.revisions.Set(revision, {revision, now_ns_, draft.cause, draft.session});
    }
    contents_.versions.Set({map, revision}, draft.state);
  }
  return std::move(contents_);
}

Change::Draft& Change::Edit(MapId map) {
  const auto [position, is_new] = drafts_.try_emplace(map);
  Draft& draft = position->second;
  if (is_new) {
    draft.state = std::make_shared<MapState>(*contents_.FindMap(map));
    contents_.maps.Set(map, draft.state);
  }
  return draft;
}

MapState& Change::Revise(MapId map) {
  Draft& draft = Edit(map);
  Revision& revision = draft.state->record.revision;
  if (!draft.has_revision) revision = Revision(revision.value() + 1);
  draft.has_revision = true;
  return *draft.state;
}

StatusOr<MapId> Change::CreateMap(const MapRecord& map) {
  MAPP_RETURN_IF_ERROR(internal::CheckMap(map));
  if (contents_.FindMap(map.name) != nullptr) return internal::MapExists(map.name);
  const MapId id(contents_.next.map++);
  MapState state;
  state.record.id = id;
  state.record.name = map.name;
  state.record.created_ns = map.created_ns != 0 ? map.created_ns : now_ns_;
  state.record.tile_edge_m = map.tile_edge_m;
  state.record.cone_range_m = map.cone_range_m;
  state.record.features = map.features;
  const auto empty = std::make_shared<const MapState>(std::move(state));
  contents_.maps.Set(id, empty);
  contents_.versions.Set({id, Revision(0)}, empty);
  return id;
}

Status Change::DeleteMap(MapId map) {
  const MapState* const state = contents_.FindMap(map);
  if (state == nullptr) return internal::NoSuchMap(map);
  std::set<CameraId> unused = CamerasOf(*state);
  for (uint64_t revision = 0; revision <= state->record.revision.value(); ++revision) {
    contents_.versions.Erase({map, Revision(revision)});
  }
  contents_.maps.Erase(map);
  drafts_.erase(map);
  EraseCamerasIfUnused(std::move(unused));
  return absl::OkStatus();
}

void Change::EraseCamerasIfUnused(std::set<CameraId> cameras) {
  contents_.maps.ForEach([&](MapId, const MapStatePtr& map) {
    for (const CameraId camera : CamerasOf(*map)) cameras.erase(camera);
  });
  for (const CameraId camera : cameras) contents_.cameras.Erase(camera);
}

Status Change::SetFounder(MapId map, std::optional<SessionId> founder) {
  if (contents_.FindMap(map) == nullptr) return internal::NoSuchMap(map);
  Edit(map).state->record.founder = founder;
  return absl::OkStatus();
}

Status Change::SetMetricScale(MapId map, bool has_metric_scale) {
  if (contents_.FindMap(map) == nullptr) return internal::NoSuchMap(map);
  Edit(map).state->record.has_metric_scale = has_metric_scale;
  return absl::OkStatus();
}

Status Change::SkipIds(MapId map, SessionId session, FrameId frame) {
  NextIds& next = contents_.next;
  next.map = std::max(next.map, map.value());
  next.session = std::max(next.session, session.value());
  next.frame = std::max(next.frame, frame.value());
  return absl::OkStatus();
}

StatusOr<CameraId> Change::InsertCamera(const Camera& camera) {
  MAPP_RETURN_IF_ERROR(internal::CheckCamera(camera));
  const CameraId id(contents_.next.camera++);
  contents_.cameras.Set(id, camera);
  return id;
}

StatusOr<SessionId> Change::InsertSession(const SessionRecord& session) {
  MAPP_RETURN_IF_ERROR(internal::CheckSession(session));
  if (contents_.FindMap(session.map) == nullptr) return internal::NoSuchMap(session.map);
  if (contents_.cameras.Find(session.camera) == nullptr) return internal::NoSuchCamera(session.camera);
  SessionRecord inserted;
  inserted.id = SessionId(contents_.next.session++);
  inserted.map = session.map;
  inserted.device = session.device;
  inserted.camera = session.camera;
  inserted.sensor = session.sensor;
  inserted.opened_ns = session.opened_ns != 0 ? session.opened_ns : now_ns_;
  CopyState(session, &inserted);
  MapState& map = *Edit(session.map).state;
  map.sessions.Set(inserted.id, inserted);
  ++map.record.num_sessions;
  return inserted.id;
}

Status Change::UpdateSession(const SessionRecord& session) {
  MAPP_RETURN_IF_ERROR(internal::CheckSession(session));
  const MapState* const map = contents_.MapOfSession(session.id);
  if (map == nullptr) return internal::NoSuchSession(session.id);
  SessionRecord updated = *map->sessions.Find(session.id);
  CopyState(session, &updated);
  Edit(map->record.id).state->sessions.Set(session.id, std::move(updated));
  return absl::OkStatus();
}

StatusOr<Revision> Change::NextRevision(MapId map) {
  if (contents_.FindMap(map) == nullptr) return internal::NoSuchMap(map);
  return Revise(map).record.revision;
}

Status Change::SetCause(MapId map, RevisionCause cause, std::optional<SessionId> session) {
  MAPP_RETURN_IF_ERROR(internal::CheckCause(cause));
  if (contents_.FindMap(map) == nullptr) return internal::NoSuchMap(map);
  Draft& draft = Edit(map);
  draft.cause = cause;
  draft.session = session;
  return absl::OkStatus();
}

Status Change::PutTag(MapId map, const std::string& name, Revision revision) {
  MAPP_RETURN_IF_ERROR(internal::CheckTagName(name));
  const MapState* const state = contents_.FindMap(map);
  if (state == nullptr) return internal::NoSuchMap(map);
  MAPP_RETURN_IF_ERROR(internal::CheckRevision(state->record, revision));
  Edit(map).state->tags.Set(name, {name, revision, now_ns_});
  return absl::OkStatus();
}

Status Change::DeleteTag(MapId map, const std::string& name) {
  const MapState* const state = contents_.FindMap(map);
  if (state == nullptr) return internal::NoSuchMap(map);
  if (state->tags.Find(name) == nullptr) return internal::NoSuchTag(state->record, name);
  Edit(map).state->tags.Erase(name);
  return absl::OkStatus();
}

StatusOr<int64_t> Change::DropHistory(MapId map, Revision oldest, int64_t max_rows) {
  const MapState* const state = contents_.FindMap(map);
  if (state == nullptr) return internal::NoSuchMap(map);
  MAPP_RETURN_IF_ERROR(internal::CheckRevision(state->record, oldest));
  Edit(map).state->record.oldest_revision = oldest;
  std::vector<Revision> dropped = contents_.VersionsBefore(map, oldest);
  dropped.resize(std::min(dropped.size(), static_cast<size_t>(std::max<int64_t>(1, max_rows))));
  for (const Revision revision : dropped) contents_.versions.Erase({map, revision});
  return static_cast<int64_t>(dropped.size());
}

Status Change::AppendPlaceBlock(MapId map, const std::string& block) {
  if (contents_.FindMap(map) == nullptr) return internal::NoSuchMap(map);
  MapState& state = *Edit(map).state;
  state.place_blocks.Set(state.num_place_blocks++, block);
  return absl::OkStatus();
}

}  // namespace mapp::memory
