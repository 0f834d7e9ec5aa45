// Points and tiles of a change: their half of MapWriter.
#include "storage/checks.h"
#include "storage/memory/change.h"

namespace mapp::memory {
namespace {

/// INVALID_ARGUMENT when the point is in the map and outside of its tiling.
Status CheckTile(const MapState& map, const PointRecord& point) {
  return point.in_map ? internal::TileAt(map.record.tile_edge_m, point.position).status() : absl::OkStatus();
}

/// Of a point that has passed CheckTile.
TileKey TileOf(const MapState& map, const PointRecord& point) {
  return TileGrid{map.record.tile_edge_m}.KeyOf(point.position);
}

/// Whether some session has ever given the point a number.
bool EverLived(const Contents& contents, MapPointId point) {
  bool found = false;
  contents.maps.ForEach([&](MapId, const MapStatePtr& map) {
    map->session_points.ForEach([&](const auto& key, Present) { found = found || std::get<2>(key) == point; });
  });
  return found;
}

StoredTile TileOrNew(const MapState& map, const TileKey& key) {
  const StoredTile* const tile = map.tiles.Find(key);
  return tile != nullptr ? *tile : StoredTile();
}

}  // namespace

void Change::ChangeTile(MapState& map, const TileKey& key, int64_t num_points) {
  StoredTile tile = TileOrNew(map, key);
  tile.revision = map.record.revision;
  tile.num_points += num_points;
  map.tiles.Set(key, std::move(tile));
  map.record.num_points += num_points;
}

void Change::EnterTile(MapState& map, const PointRecord& point) {
  if (!point.in_map) return;
  const TileKey key = TileOf(map, point);
  map.tile_points.Set({key, point.id}, {});
  ChangeTile(map, key, 1);
}

void Change::LeaveTile(MapState& map, const PointRecord& point) {
  if (!point.in_map) return;
  const TileKey key = TileOf(map, point);
  map.tile_points.Erase({key, point.id});
  ChangeTile(map, key, -1);
}

StatusOr<MapPointId> Change::InsertPoint(MapId map, const PointRecord& point) {
  MAPP_RETURN_IF_ERROR(internal::CheckPoint(point));
  const MapState* const map_of_session = contents_.MapOfSession(point.session);
  if (map_of_session == nullptr) return internal::NoSuchSession(point.session);
  MAPP_RETURN_IF_ERROR(internal::CheckPointsMap(point, map_of_session->record.id, map));
  MAPP_RETURN_IF_ERROR(CheckTile(*map_of_session, point));
  MapState& revised = Revise(map);
  PointRecord inserted = point;
  inserted.id = MapPointId(contents_.next.point++);
  inserted.created = revised.record.revision;
  EnterTile(revised, inserted);
  revised.session_points.Set({point.session, point.session_point, inserted.id}, {});
  revised.points.Set(inserted.id, inserted);
  return inserted.id;
}

Status Change::UpdatePoint(const PointRecord& point) {
  MAPP_RETURN_IF_ERROR(internal::CheckPoint(point));
  const MapState* const map = contents_.MapOfPoint(point.id);
  if (map == nullptr) return internal::NoSuchPoint(point.id);
  MAPP_RETURN_IF_ERROR(CheckTile(*map, point));
  MapState& revised = Revise(map->record.id);
  PointRecord updated = *revised.points.Find(point.id);
  LeaveTile(revised, updated);
  updated.in_map = point.in_map;
  updated.position = point.position;
  updated.view_direction = point.view_direction;
  updated.descriptor = point.descriptor;
  updated.created = revised.record.revision;
  EnterTile(revised, updated);
  revised.points.Set(point.id, std::move(updated));
  return absl::OkStatus();
}

Status Change::TouchPoint(const PointRecord& point) {
  MAPP_RETURN_IF_ERROR(internal::CheckPoint(point));
  const MapState* const map = contents_.MapOfSession(point.session);
  if (map == nullptr) return internal::NoSuchSession(point.session);
  MAPP_RETURN_IF_ERROR(CheckTile(*map, point));
  if (map->points.Find(point.id) == nullptr) return internal::NoSuchPoint(point.id);
  PointRecord touched = *map->points.Find(point.id);
  touched.view_direction = point.view_direction;
  touched.descriptor = point.descriptor;
  touched.reference_distance_m = point.reference_distance_m;
  touched.num_observations = point.num_observations;
  touched.confidence = point.confidence;
  touched.observers = point.observers;
  // Only what is in a tile makes a revision: a fragment's point has no reader but its session.
  MapState& state = touched.in_map ? Revise(map->record.id) : *Edit(map->record.id).state;
  if (touched.in_map) ChangeTile(state, TileOf(state, touched), 0);
  state.points.Set(point.id, std::move(touched));
  return absl::OkStatus();
}

Status Change::RetirePoint(MapPointId point, std::optional<MapPointId> fused_into) {
  const MapState* const map = contents_.MapOfPoint(point);
  if (map == nullptr) return internal::NoSuchPoint(point);
  MAPP_RETURN_IF_ERROR(internal::CheckFusesIntoAnother(point, fused_into));
  if (fused_into) {
    const MapState* const map_of_successor = contents_.MapOfPoint(*fused_into);
    if (map_of_successor == nullptr) return internal::NoSuchPoint(*fused_into);
    MAPP_RETURN_IF_ERROR(internal::CheckFusion(map->record.id, map_of_successor->record.id));
  }
  MapState& revised = Revise(map->record.id);
  LeaveTile(revised, *revised.points.Find(point));
  revised.points.Erase(point);
  revised.retired.Set(point, fused_into);
  return absl::OkStatus();
}

Status Change::ReturnPoint(const PointRecord& point) {
  MAPP_RETURN_IF_ERROR(internal::CheckPoint(point));
  const MapState* const map = contents_.MapOfSession(point.session);
  if (map == nullptr) return internal::NoSuchSession(point.session);
  if (contents_.MapOfPoint(point.id) != nullptr) return internal::StillLives(point.id);
  if (map->session_points.Find({point.session, point.session_point, point.id}) == nullptr) {
    return EverLived(contents_, point.id) ? internal::HasAnotherNumber(point) : internal::NeverLived(point.id);
  }
  const std::optional<MapPointId>* const successor = map->retired.Find(point.id);
  if (successor != nullptr && *successor) return internal::IsFused(point.id);
  MAPP_RETURN_IF_ERROR(CheckTile(*map, point));
  MapState& revised = Revise(map->record.id);
  PointRecord returned = point;
  returned.created = revised.record.revision;
  EnterTile(revised, returned);
  revised.retired.Erase(point.id);
  revised.points.Set(point.id, std::move(returned));
  return absl::OkStatus();
}

Status Change::PutTileBlob(MapId map, const TileKey& tile, const TileBlob& blob) {
  if (contents_.FindMap(map) == nullptr) return internal::NoSuchMap(map);
  MapState& state = *Edit(map).state;
  StoredTile stored = TileOrNew(state, tile);
  // A tile encoded from an older snapshot must not replace a newer one.
  if (stored.blob != nullptr && blob.revision < stored.blob->revision) return absl::OkStatus();
  stored.blob = std::make_shared<const TileBlob>(blob);
  state.tiles.Set(tile, std::move(stored));
  return absl::OkStatus();
}

}  // namespace mapp::memory
