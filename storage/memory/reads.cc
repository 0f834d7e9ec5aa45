#include "storage/memory/reads.h"

#include "storage/checks.h"
#include "storage/memory/diff.h"

namespace mapp::memory {
namespace {

/// The live point that `point` stands for now.
std::optional<MapPointId> FollowFusion(const MapState& map, MapPointId point) {
  // A point fuses into one that lives, so a chain never meets itself.
  while (map.points.Find(point) == nullptr) {
    const std::optional<MapPointId>* const successor = map.retired.Find(point);
    if (successor == nullptr || !*successor) return std::nullopt;
    point = **successor;
  }
  return point;
}

std::optional<MapPointId> NewestOfNumber(const MapState& map, SessionId session, uint64_t session_point) {
  std::optional<MapPointId> newest;
  map.session_points.ForEachFrom({session, session_point, MapPointId(0)}, [&](const auto& key, Present) {
    if (std::get<0>(key) != session || std::get<1>(key) != session_point) return false;
    newest = std::get<2>(key);
    return true;
  });
  return newest;
}

bool Contains(const Aabb& box, const Eigen::Vector3d& p) {
  return (box.min().array() <= p.array()).all() && (p.array() <= box.max().array()).all();
}

}  // namespace

template <typename Interface>
StatusOr<std::vector<MapRecord>> Reads<Interface>::ListMaps() {
  std::vector<MapRecord> records;
  contents_.maps.ForEach([&](MapId, const MapStatePtr& map) { records.push_back(map->record); });
  return records;
}

template <typename Interface>
StatusOr<MapRecord> Reads<Interface>::FindMap(const std::string& name) {
  const MapState* const map = contents_.FindMap(name);
  if (map == nullptr) return internal::NoSuchMap(name);
  return map->record;
}

template <typename Interface>
StatusOr<MapRecord> Reads<Interface>::GetMap(MapId map) {
  const MapState* const found = contents_.FindMap(map);
  if (found == nullptr) return internal::NoSuchMap(map);
  return found->record;
}

template <typename Interface>
StatusOr<std::vector<SessionRecord>> Reads<Interface>::ListSessions(std::optional<MapId> map) {
  PersistentMap<SessionId, SessionRecord> sorted;
  contents_.maps.ForEach([&](MapId id, const MapStatePtr& state) {
    if (map && id != *map) return;
    state->sessions.ForEach([&](SessionId session, const SessionRecord& record) { sorted.Set(session, record); });
  });
  std::vector<SessionRecord> records;
  sorted.ForEach([&](SessionId, const SessionRecord& record) { records.push_back(record); });
  return records;
}

template <typename Interface>
StatusOr<SessionRecord> Reads<Interface>::GetSession(SessionId session) {
  const MapState* const map = contents_.MapOfSession(session);
  if (map == nullptr) return internal::NoSuchSession(session);
  return *map->sessions.Find(session);
}

template <typename Interface>
StatusOr<CameraRecord> Reads<Interface>::GetCamera(CameraId camera) {
  const Camera* const found = contents_.cameras.Find(camera);
  if (found == nullptr) return internal::NoSuchCamera(camera);
  return CameraRecord{.id = camera, .camera = *found};
}

template <typename Interface>
StatusOr<std::optional<FrameId>> Reads<Interface>::FindFrame(SessionId session, uint32_t number) {
  const MapState* const map = contents_.MapOfSession(session);
  if (map == nullptr) return std::nullopt;
  const FrameId* const frame = map->frames_by_number.Find({session, number});
  return frame != nullptr ? std::optional(*frame) : std::nullopt;
}

template <typename Interface>
StatusOr<FrameRecord> Reads<Interface>::GetFrame(FrameId frame) {
  const MapState* const map = contents_.MapOfFrame(frame);
  if (map == nullptr) return internal::NoSuchFrame(frame);
  return map->frames.Find(frame)->record;
}

template <typename Interface>
StatusOr<std::vector<FrameRecord>> Reads<Interface>::ListFrames(MapId map, std::optional<SessionId> session) {
  std::vector<FrameRecord> records;
  const MapState* const state = contents_.FindMap(map);
  if (state == nullptr) return records;
  state->frames.ForEach([&](FrameId, const StoredFrame& frame) {
    if (!session || frame.record.session == *session) records.push_back(frame.record);
  });
  return records;
}

template <typename Interface>
StatusOr<std::vector<FrameRecord>> Reads<Interface>::FramesInBox(MapId map, const Aabb& box_map) {
  std::vector<FrameRecord> records;
  const MapState* const state = contents_.FindMap(map);
  if (state == nullptr) return records;
  state->frames.ForEach([&](FrameId, const StoredFrame& frame) {
    if (frame.record.in_map && Contains(box_map, frame.record.T_frame_camera.translation())) {
      records.push_back(frame.record);
    }
  });
  return records;
}

template <typename Interface>
StatusOr<std::string> Reads<Interface>::GetPacket(FrameId frame) {
  const MapState* const map = contents_.MapOfFrame(frame);
  if (map == nullptr) return internal::NoSuchFrame(frame);
  return *map->frames.Find(frame)->packet;
}

template <typename Interface>
StatusOr<std::vector<Observation>> Reads<Interface>::GetObservations(FrameId frame) {
  const MapState* const map = contents_.MapOfFrame(frame);
  if (map == nullptr) return internal::NoSuchFrame(frame);
  return *map->frames.Find(frame)->observations;
}

template <typename Interface>
StatusOr<std::vector<PointRecord>> Reads<Interface>::GetPoints(std::span<const MapPointId> points) {
  std::vector<PointRecord> records;
  records.reserve(points.size());
  for (const MapPointId point : points) {
    const MapState* const map = contents_.MapOfPoint(point);
    if (map == nullptr) return internal::NoSuchPoint(point);
    records.push_back(*map->points.Find(point));
  }
  return records;
}

template <typename Interface>
StatusOr<std::vector<PointRecord>> Reads<Interface>::FindPoints(std::span<const MapPointId> points) {
  std::vector<PointRecord> records;
  records.reserve(points.size());
  for (const MapPointId point : points) {
    const MapState* const map = contents_.MapOfPoint(point);
    if (map != nullptr) records.push_back(*map->points.Find(point));
  }
  return records;
}

template <typename Interface>
StatusOr<std::vector<std::optional<MapPointId>>> Reads<Interface>::FindSessionPoints(
    SessionId session, std::span<const uint64_t> session_points) {
  std::vector<std::optional<MapPointId>> found(session_points.size());
  const MapState* const map = contents_.MapOfSession(session);
  if (map == nullptr) return found;
  for (size_t i = 0; i < session_points.size(); ++i) {
    const std::optional<MapPointId> newest = NewestOfNumber(*map, session, session_points[i]);
    if (newest) found[i] = FollowFusion(*map, *newest);
  }
  return found;
}

template <typename Interface>
StatusOr<std::vector<NumberedPoint>> Reads<Interface>::ListNumberedPoints(SessionId session) {
  std::vector<NumberedPoint> points;
  const MapState* const state = contents_.MapOfSession(session);
  if (state == nullptr) return points;
  state->session_points.ForEachFrom({session, 0, MapPointId(0)}, [&](const auto& key, Present) {
    if (std::get<0>(key) != session) return false;
    points.push_back({std::get<1>(key), std::get<2>(key)});
    return true;
  });
  return points;
}

template <typename Interface>
StatusOr<std::vector<PointRecord>> Reads<Interface>::PointsInTile(MapId map, const TileKey& tile) {
  std::vector<PointRecord> records;
  const MapState* const state = contents_.FindMap(map);
  if (state == nullptr) return records;
  state->tile_points.ForEachFrom({tile, MapPointId(0)}, [&](const auto& key, Present) {
    if (key.first != tile) return false;
    records.push_back(*state->points.Find(key.second));
    return true;
  });
  return records;
}

template <typename Interface>
StatusOr<std::vector<PointRecord>> Reads<Interface>::PointsOfSession(SessionId session) {
  std::vector<PointRecord> records;
  const MapState* const map = contents_.MapOfSession(session);
  if (map == nullptr) return records;
  map->session_points.ForEachFrom({session, 0, MapPointId(0)}, [&](const auto& key, Present) {
    if (std::get<0>(key) != session) return false;
    const PointRecord* const point = map->points.Find(std::get<2>(key));
    if (point != nullptr) records.push_back(*point);
    return true;
  });
  return records;
}

template <typename Interface>
StatusOr<std::vector<TileRecord>> Reads<Interface>::ListTiles(MapId map, const std::optional<Aabb>& box_map) {
  const MapState* const state = contents_.FindMap(map);
  if (state == nullptr) return internal::NoSuchMap(map);
  const TileGrid grid{state->record.tile_edge_m};
  std::vector<TileRecord> records;
  state->tiles.ForEach([&](const TileKey& key, const StoredTile& tile) {
    if (tile.num_points == 0 || (box_map && !grid.BoxOf(key).intersects(*box_map))) return;
    records.push_back({.key = key, .revision = tile.revision, .num_points = tile.num_points});
  });
  return records;
}

template <typename Interface>
StatusOr<std::optional<TileBlob>> Reads<Interface>::GetTileBlob(MapId map, const TileKey& tile) {
  const MapState* const state = contents_.FindMap(map);
  const StoredTile* const found = state != nullptr ? state->tiles.Find(tile) : nullptr;
  if (found == nullptr || found->blob == nullptr) return std::nullopt;
  return *found->blob;
}

template <typename Interface>
StatusOr<std::vector<std::string>> Reads<Interface>::ListPlaceBlocks(MapId map) {
  std::vector<std::string> blocks;
  const MapState* const state = contents_.FindMap(map);
  if (state == nullptr) return blocks;
  state->place_blocks.ForEach([&](uint64_t, const std::string& block) { blocks.push_back(block); });
  return blocks;
}

// Of sessions that a reader of the past does not know yet, too.
template <typename Interface>
StatusOr<std::vector<EvidenceRecord>> Reads<Interface>::ListEvidence(SessionId session) {
  std::vector<EvidenceRecord> records;
  contents_.maps.ForEach([&](MapId, const MapStatePtr& map) {
    map->evidence.ForEachFrom({session, 0}, [&](const auto& key, const EvidenceRecord& evidence) {
      if (key.first != session) return false;
      records.push_back(evidence);
      return true;
    });
  });
  return records;
}

template <typename Interface>
StatusOr<bool> Reads<Interface>::HasEvidence(SessionId session, uint32_t number) {
  bool found = false;
  contents_.maps.ForEach([&](MapId, const MapStatePtr& map) {
    found = found || map->evidence.Find({session, number}) != nullptr;
  });
  return found;
}

template <typename Interface>
StatusOr<std::optional<std::string>> Reads<Interface>::FindFindings(SessionId session) {
  std::optional<std::string> found;
  contents_.maps.ForEach([&](MapId, const MapStatePtr& map) {
    if (const std::string* const findings = map->findings.Find(session); findings != nullptr) found = *findings;
  });
  return found;
}

template <typename Interface>
StatusOr<std::vector<ChangeRecord>> Reads<Interface>::ListChanges(MapId map) {
  const MapState* const state = contents_.FindMap(map);
  if (state == nullptr) return internal::NoSuchMap(map);
  std::vector<ChangeRecord> records;
  state->changes.ForEach([&](ChangeId, const ChangeRecord& change) { records.push_back(change); });
  return records;
}

template <typename Interface>
StatusOr<ChangeRecord> Reads<Interface>::GetChange(ChangeId change) {
  const MapState* const map = contents_.MapOfChange(change);
  if (map == nullptr) return internal::NoSuchChange(change);
  return *map->changes.Find(change);
}

template <typename Interface>
StatusOr<std::vector<RevisionRecord>> Reads<Interface>::ListRevisions(MapId map, Revision first, Revision last) {
  const MapState* const state = contents_.FindMap(map);
  if (state == nullptr) return internal::NoSuchMap(map);
  std::vector<RevisionRecord> records;
  state->revisions.ForEachFrom(first, [&](Revision revision, const RevisionRecord& record) {
    if (revision > last) return false;
    records.push_back(record);
    return true;
  });
  return records;
}

template <typename Interface>
StatusOr<std::vector<TagRecord>> Reads<Interface>::ListTags(MapId map) {
  const MapState* const state = contents_.FindMap(map);
  if (state == nullptr) return internal::NoSuchMap(map);
  std::vector<TagRecord> records;
  state->tags.ForEach([&](const std::string&, const TagRecord& tag) { records.push_back(tag); });
  return records;
}

template <typename Interface>
StatusOr<std::vector<SessionDiff>> Reads<Interface>::DiffRevisions(MapId map, Revision from, Revision to) {
  MAPP_RETURN_IF_ERROR(internal::CheckRevisionOrder(from, to));
  const MapState* const state = contents_.FindMap(map);
  if (state == nullptr) return internal::NoSuchMap(map);
  MAPP_RETURN_IF_ERROR(internal::CheckRevision(state->record, from));
  MAPP_RETURN_IF_ERROR(internal::CheckRevision(state->record, to));
  return Diff(contents_.At(*state, from), contents_.At(*state, to));
}

template <typename Interface>
StatusOr<int64_t> Reads<Interface>::CountHistory(MapId map, Revision oldest) {
  const MapState* const state = contents_.FindMap(map);
  if (state == nullptr) return internal::NoSuchMap(map);
  MAPP_RETURN_IF_ERROR(internal::CheckRevision(state->record, oldest));
  return static_cast<int64_t>(contents_.VersionsBefore(map, oldest).size());
}

template class Reads<MapReader>;
template class Reads<MapWriter>;

}  // namespace mapp::memory
