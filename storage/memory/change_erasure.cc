// What is forgotten for good: that part of MapWriter.
#include "storage/checks.h"
#include "storage/memory/change.h"

#include <algorithm>
#include <map>
#include <vector>

namespace mapp::memory {
namespace {

/// Why the session cannot be erased yet, or OK.
Status CheckErasable(const MapState& map, SessionId session) {
  bool has_frames = false, has_points = false;
  map.frames.ForEach([&](FrameId, const StoredFrame& frame) {
    has_frames = has_frames || (frame.record.session == session && frame.record.in_map);
  });
  if (has_frames) return internal::StillHoldsFrames(session);
  map.points.ForEach(
      [&](MapPointId, const PointRecord& point) { has_points = has_points || point.session == session; });
  if (has_points) return internal::StillHoldsPoints(session);
  if (map.record.founder == session) return internal::StillFounds(session);
  return map.record.oldest_revision == map.record.revision ? absl::OkStatus() : internal::StillHasHistory(map.record);
}

/// The session's points that live no more.
std::vector<MapPointId> PointsOf(const MapState& map, SessionId session) {
  std::vector<MapPointId> points;
  map.session_points.ForEachFrom({session, 0, MapPointId(0)}, [&](const auto& key, Present) {
    if (std::get<0>(key) != session) return false;
    points.push_back(std::get<2>(key));
    return true;
  });
  std::erase_if(points, [&](MapPointId point) { return map.points.Find(point) != nullptr; });
  return points;
}

void ErasePoints(SessionId session, MapState* map) {
  std::map<MapPointId, std::optional<MapPointId>> erased;
  for (const MapPointId point : PointsOf(*map, session)) erased.emplace(point, *map->retired.Find(point));
  for (const auto& [point, successor] : erased) map->retired.Erase(point);
  // Points of others that were fused into the session's lead past them, to where those lead.
  std::vector<std::pair<MapPointId, std::optional<MapPointId>>> led_past;
  map->retired.ForEach([&](MapPointId point, std::optional<MapPointId> successor) {
    if (!successor || !erased.contains(*successor)) return;
    while (successor && erased.contains(*successor)) successor = erased.at(*successor);
    led_past.emplace_back(point, successor);
  });
  for (const auto& [point, successor] : led_past) map->retired.Set(point, successor);
  std::vector<std::tuple<SessionId, uint64_t, MapPointId>> numbers;
  map->session_points.ForEachFrom({session, 0, MapPointId(0)}, [&](const auto& key, Present) {
    if (std::get<0>(key) != session) return false;
    numbers.push_back(key);
    return true;
  });
  for (const auto& key : numbers) map->session_points.Erase(key);
}

void EraseFrames(SessionId session, MapState* map) {
  std::vector<std::pair<FrameId, uint32_t>> frames;
  map->frames.ForEach([&](FrameId id, const StoredFrame& frame) {
    if (frame.record.session == session) frames.emplace_back(id, frame.record.number);
  });
  for (const auto& [id, number] : frames) {
    map->frames.Erase(id);
    map->frames_by_number.Erase({session, number});
  }
}

void EraseEvidence(SessionId session, MapState* map) {
  std::vector<std::pair<SessionId, uint32_t>> numbers;
  map->evidence.ForEachFrom({session, 0}, [&](const auto& key, const EvidenceRecord&) {
    if (key.first == session) numbers.push_back(key);
    return key.first == session;
  });
  for (const auto& key : numbers) map->evidence.Erase(key);
}

/// What a change rests on no more; it goes when nothing is left.
void EraseFromChanges(SessionId session, MapState* map) {
  std::vector<ChangeRecord> resting;
  map->changes.ForEach([&](ChangeId, const ChangeRecord& change) {
    if (std::ranges::binary_search(change.sessions, session)) resting.push_back(change);
  });
  for (ChangeRecord& change : resting) {
    std::erase(change.sessions, session);
    if (change.sessions.empty()) {
      map->changes.Erase(change.id);
    } else {
      map->changes.Set(change.id, change);
    }
  }
}

/// Encoded tiles, place blocks and findings: what they show of one session is not told apart.
void DropDerived(MapState* map) {
  PersistentMap<TileKey, StoredTile> tiles;
  map->tiles.ForEach([&](const TileKey& key, StoredTile tile) {
    tile.blob = nullptr;
    tiles.Set(key, std::move(tile));
  });
  map->tiles = std::move(tiles);
  map->place_blocks = {};
  map->num_place_blocks = 0;
  map->findings = {};
}

void ForgetCause(SessionId session, MapState* map) {
  std::vector<RevisionRecord> revisions;
  map->revisions.ForEach([&](Revision, const RevisionRecord& revision) {
    if (revision.session == session) revisions.push_back(revision);
  });
  for (RevisionRecord& revision : revisions) {
    revision.session.reset();
    map->revisions.Set(revision.revision, revision);
  }
}

}  // namespace

Status Change::AdoptPoint(MapPointId point, SessionId session, uint64_t session_point,
                          const OrbDescriptor& descriptor) {
  const MapState* const map = contents_.MapOfPoint(point);
  if (map == nullptr) return internal::NoSuchPoint(point);
  const MapState* const map_of_session = contents_.MapOfSession(session);
  if (map_of_session == nullptr) return internal::NoSuchSession(session);
  PointRecord adopted = *map->points.Find(point);
  adopted.session = session;
  adopted.session_point = session_point;
  adopted.descriptor = descriptor;
  MAPP_RETURN_IF_ERROR(internal::CheckPointsMap(adopted, map_of_session->record.id, map->record.id));
  MapState& state = adopted.in_map ? Revise(map->record.id) : *Edit(map->record.id).state;
  if (adopted.in_map) ChangeTile(state, TileGrid{state.record.tile_edge_m}.KeyOf(adopted.position), 0);
  state.session_points.Set({session, session_point, point}, {});
  state.points.Set(point, std::move(adopted));
  return absl::OkStatus();
}

Status Change::EraseSession(SessionId session) {
  const MapState* const map = contents_.MapOfSession(session);
  if (map == nullptr) return internal::NoSuchSession(session);
  MAPP_RETURN_IF_ERROR(CheckErasable(*map, session));
  const CameraId camera = map->sessions.Find(session)->camera;
  Draft& draft = Edit(map->record.id);
  MapState& state = *draft.state;
  ErasePoints(session, &state);
  EraseFrames(session, &state);
  EraseEvidence(session, &state);
  EraseFromChanges(session, &state);
  DropDerived(&state);
  ForgetCause(session, &state);
  if (draft.session == session) draft.session.reset();
  state.sessions.Erase(session);
  --state.record.num_sessions;
  EraseCamerasIfUnused({camera});
  return absl::OkStatus();
}

}  // namespace mapp::memory
