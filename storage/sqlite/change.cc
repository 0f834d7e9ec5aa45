#include "storage/sqlite/change.h"

namespace mapp::sqlite {

StatusOr<std::vector<MapRecord>> Change::ListMaps() {
  MAPP_RETURN_IF_ERROR(ledger_.Flush());
  return MapReads::ListMaps();
}

StatusOr<MapRecord> Change::FindMap(const std::string& name) {
  MAPP_RETURN_IF_ERROR(ledger_.Flush());
  return MapReads::FindMap(name);
}

StatusOr<MapRecord> Change::GetMap(MapId map) {
  MAPP_RETURN_IF_ERROR(ledger_.Flush());
  return MapReads::GetMap(map);
}

StatusOr<std::vector<TileRecord>> Change::ListTiles(MapId map, const std::optional<Aabb>& box_map) {
  MAPP_RETURN_IF_ERROR(ledger_.Flush());
  return MapReads::ListTiles(map, box_map);
}

StatusOr<std::vector<SessionDiff>> Change::DiffRevisions(MapId map, Revision from, Revision to) {
  MAPP_RETURN_IF_ERROR(ledger_.Flush());
  return MapReads::DiffRevisions(map, from, to);
}

}  // namespace mapp::sqlite
