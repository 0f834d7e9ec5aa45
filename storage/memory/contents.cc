#include "storage/memory/contents.h"

#include "storage/checks.h"

namespace mapp::memory {
namespace {

/// The first map of which `has` is true.
template <typename Has>
const MapState* FindIf(const PersistentMap<MapId, MapStatePtr>& maps, Has has) {
  const MapState* found = nullptr;
  maps.ForEachFrom(MapId(0), [&](MapId, const MapStatePtr& map) {
    if (has(*map)) found = map.get();
    return found == nullptr;
  });
  return found;
}

/// Of the blobs as they are now, those that hold what a tile with points was at `revision`.
void TakeBlobs(const MapState& now, Revision revision, MapState* past) {
  PersistentMap<TileKey, StoredTile> tiles;
  past->tiles.ForEach([&](const TileKey& key, StoredTile tile) {
    const StoredTile* const is = now.tiles.Find(key);
    tile.blob = tile.num_points > 0 && is->revision <= revision ? is->blob : nullptr;
    tiles.Set(key, std::move(tile));
  });
  past->tiles = std::move(tiles);
}

}  // namespace

const MapState* Contents::FindMap(MapId map) const {
  const MapStatePtr* const found = maps.Find(map);
  return found != nullptr ? found->get() : nullptr;
}

const MapState* Contents::FindMap(const std::string& name) const {
  return FindIf(maps, [&name](const MapState& map) { return map.record.name == name; });
}

const MapState* Contents::MapOfSession(SessionId session) const {
  return FindIf(maps, [session](const MapState& map) { return map.sessions.Find(session) != nullptr; });
}

const MapState* Contents::MapOfFrame(FrameId frame) const {
  return FindIf(maps, [frame](const MapState& map) { return map.frames.Find(frame) != nullptr; });
}

const MapState* Contents::MapOfPoint(MapPointId live_point) const {
  return FindIf(maps, [live_point](const MapState& map) { return map.points.Find(live_point) != nullptr; });
}

const MapState* Contents::MapOfChange(ChangeId change) const {
  return FindIf(maps, [change](const MapState& map) { return map.changes.Find(change) != nullptr; });
}

const MapState& Contents::At(const MapState& map, Revision revision) const {
  if (revision == map.record.revision) return map;
  return **versions.Find({map.record.id, revision});
}

std::vector<Revision> Contents::VersionsBefore(MapId map, Revision oldest) const {
  std::vector<Revision> revisions;
  versions.ForEachFrom({map, Revision(0)}, [&](const std::pair<MapId, Revision>& version, const MapStatePtr&) {
    if (version.first != map || version.second >= oldest) return false;
    revisions.push_back(version.second);
    return true;
  });
  return revisions;
}

StatusOr<Contents> Contents::AsOf(MapId map, Revision revision) const {
  const MapState* const now = FindMap(map);
  if (now == nullptr) return internal::NoSuchMap(map);
  MAPP_RETURN_IF_ERROR(internal::CheckRevision(now->record, revision));
  MapState past = At(*now, revision);
  TakeBlobs(*now, revision, &past);
  past.place_blocks = now->place_blocks;
  past.evidence = now->evidence;
  past.findings = now->findings;
  past.changes = now->changes;
  past.tags = {};
  now->tags.ForEach([&](const std::string& name, const TagRecord& tag) {
    if (tag.revision <= revision) past.tags.Set(name, tag);
  });
  Contents contents;
  contents.maps.Set(map, std::make_shared<const MapState>(std::move(past)));
  contents.versions = versions;
  contents.cameras = cameras;
  return contents;
}

}  // namespace mapp::memory
