#include "storage/sqlite/place_blocks.h"

#include "storage/sqlite/catalog.h"
#include "storage/sqlite/statement.h"

namespace mapp::sqlite {

StatusOr<std::vector<std::string>> ListPlaceBlocks(Connection& db, MapId map) {
  Statement query = db.Prepare("SELECT blob FROM place_blocks WHERE map_id = ? ORDER BY block");
  query.Bind(map);
  std::vector<std::string> blocks;
  for (;;) {
    MAPP_ASSIGN_OR_RETURN(const bool has_row, query.Step());
    if (!has_row) return blocks;
    blocks.emplace_back(query.Bytes(0));
  }
}

Status AppendPlaceBlock(Connection& db, MapId map, const std::string& block) {
  MAPP_RETURN_IF_ERROR(GetMap(db, map).status());
  return db
      .Prepare(
          "INSERT INTO place_blocks (map_id, block, blob) VALUES (?1, (SELECT COALESCE(MAX(block) + 1, 0) FROM "
          "place_blocks WHERE map_id = ?1), ?2)")
      .Bind(map, Blob{block})
      .Run();
}

}  // namespace mapp::sqlite
