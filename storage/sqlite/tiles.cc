#include "storage/sqlite/tiles.h"

#include "mapp/base/bytes.h"
#include "storage/sqlite/catalog.h"

#include <fmt/format.h>

namespace mapp::sqlite {
namespace {

TileRecord ReadTile(const Statement& row) {
  return {.key = TileKey::FromPacked(static_cast<uint64_t>(row.Int64(0))),
          .revision = row.GetId<Revision>(1),
          .num_points = row.Int64(2)};
}

}  // namespace

StatusOr<std::vector<TileRecord>> ListTiles(Connection& db, MapId map, const std::optional<Aabb>& box_map) {
  MAPP_ASSIGN_OR_RETURN(const MapRecord record, GetMap(db, map));
  const TileGrid grid{record.tile_edge_m};
  Statement query =
      box_map ? db.Prepare(
                    "SELECT tile_key, revision, num_points FROM tiles WHERE map_id = ?1 AND num_points > 0 AND "
                    "tile_id IN (SELECT tile_id FROM tile_index WHERE map_min <= ?1 AND map_max >= ?1 AND "
                    "x_max_m >= ?2 AND x_min_m <= ?3 AND y_max_m >= ?4 AND y_min_m <= ?5 AND z_max_m >= ?6 AND "
                    "z_min_m <= ?7) ORDER BY tile_key")
              : db.Prepare(
                    "SELECT tile_key, revision, num_points FROM tiles WHERE map_id = ? AND num_points > 0 "
                    "ORDER BY tile_key");
  query.Bind(map);
  if (box_map) {
    query.Bind(box_map->min().x(), box_map->max().x(), box_map->min().y(), box_map->max().y(), box_map->min().z(),
               box_map->max().z());
  }
  std::vector<TileRecord> tiles;
  for (;;) {
    MAPP_ASSIGN_OR_RETURN(const bool has_row, query.Step());
    if (!has_row) return tiles;
    const TileRecord tile = ReadTile(query);
    // The index rounds bounds outwards; the exact test decides.
    if (!box_map || grid.BoxOf(tile.key).intersects(*box_map)) tiles.push_back(tile);
  }
}

StatusOr<std::optional<TileBlob>> GetTileBlob(Connection& db, MapId map, const TileKey& tile) {
  Statement query = db.Prepare(
      "SELECT b.revision, b.crc32c, b.blob FROM tiles t JOIN tile_blobs b USING (tile_id) "
      "WHERE t.map_id = ? AND t.tile_key = ?");
  MAPP_ASSIGN_OR_RETURN(const bool has_row, query.Bind(map, tile.Packed()).Step());
  if (!has_row) return std::nullopt;
  TileBlob blob{.revision = query.GetId<Revision>(0), .bytes = std::string(query.Bytes(2))};
  if (const uint32_t crc = Crc32c(blob.bytes); crc != query.Int64(1)) {
    return absl::DataLossError(fmt::format("tile {} of map {}, revision {}: crc32c {:#010x} != stored {:#010x}",
                                           tile.ToString(), map.value(), blob.revision.value(), crc, query.Int64(1)));
  }
  return blob;
}

Status PutTileBlob(Connection& db, ChangeLedger& ledger, MapId map, const TileKey& tile, const TileBlob& blob) {
  MAPP_ASSIGN_OR_RETURN(const int64_t tile_id, ledger.TileOf(map, tile));
  // A tile encoded from an older snapshot must not replace a newer one.
  return db
      .Prepare(
          "INSERT INTO tile_blobs (tile_id, revision, crc32c, blob) VALUES (?, ?, ?, ?) ON CONFLICT (tile_id) DO "
          "UPDATE SET revision = excluded.revision, crc32c = excluded.crc32c, blob = excluded.blob "
          "WHERE excluded.revision >= tile_blobs.revision")
      .Bind(tile_id, blob.revision, Crc32c(blob.bytes), Blob{blob.bytes})
      .Run();
}

}  // namespace mapp::sqlite
