#pragma once

#include "mapp/base/status.h"
#include "storage/records.h"
#include "storage/sqlite/change_ledger.h"
#include "storage/sqlite/connection.h"

#include <optional>
#include <vector>

namespace mapp::sqlite {

// Tiles and their encoded content. Promises: storage/map_store.h.

StatusOr<std::vector<TileRecord>> ListTiles(Connection& db, MapId map, const std::optional<Aabb>& box_map);
StatusOr<std::optional<TileBlob>> GetTileBlob(Connection& db, MapId map, const TileKey& tile);
Status PutTileBlob(Connection& db, ChangeLedger& ledger, MapId map, const TileKey& tile, const TileBlob& blob);

}  // namespace mapp::sqlite
