// Tiles, their encoded blobs, and the spatial indices.

#include "mapp/base/bytes.h"
#include "mapp/codec/tile_codec.h"
#include "storage/sqlite/rows.h"
#include "storage/sqlite/verify_check.h"

#include <absl/strings/str_cat.h>
#include <fmt/format.h>

#include <algorithm>
#include <limits>
#include <unordered_map>

namespace mapp::sqlite {
namespace {

constexpr const char* kTileRows = R"sql(
SELECT t.tile_id, format('of map %d, revision %d: there is no such map or revision', t.map_id, t.revision)
  FROM tiles t LEFT JOIN maps m USING (map_id) WHERE m.map_id IS NULL OR t.revision NOT BETWEEN 0 AND m.revision
UNION ALL
SELECT tile_id, format('key %d is none', tile_key) FROM tiles WHERE tile_key < 0
)sql";

constexpr const char* kCounts = R"sql(
SELECT t.tile_id, format('num_points is %d, and %d points are in it', t.num_points, coalesce(c.n, 0))
  FROM tiles t LEFT JOIN (SELECT tile_id, count(*) AS n FROM points WHERE tile_id IS NOT NULL GROUP BY tile_id) c
       USING (tile_id)
 WHERE t.num_points <> coalesce(c.n, 0)
)sql";

constexpr const char* kBlobs = R"sql(
SELECT b.tile_id, b.revision, b.crc32c, b.blob, t.tile_key, t.revision, m.tile_edge_m
  FROM tile_blobs b LEFT JOIN tiles t USING (tile_id) LEFT JOIN maps m USING (map_id)
)sql";

/// How far the codec may take a coordinate of `p_map`: steps of the edge, float32 on the way.
double PositionTolerance(double edge_m, const Eigen::Vector3d& p_map) {
  return edge_m / 65535 + 4 * std::numeric_limits<float>::epsilon() * p_map.cwiseAbs().maxCoeff();
}

/// What differs between a point of a tile's blob and its row.
std::string Difference(const TilePoint& encoded, const PointRecord& point, double edge_m) {
  const Eigen::Vector3d moved = encoded.p_map.cast<double>() - point.position;
  if (moved.cwiseAbs().maxCoeff() > PositionTolerance(edge_m, point.position)) return "position";
  if (encoded.descriptor != point.descriptor) return "descriptor";
  const uint32_t most = std::numeric_limits<uint16_t>::max();
  if (encoded.num_observations != std::min(point.num_observations, most)) return "number of observations";
  return {};
}

/// A tile of a map is in memory at a time wherever it is served, too.
StatusOr<std::string> ContentFault(Connection& db, int64_t tile_id, const Tile& tile) {
  std::unordered_map<MapPointId, const TilePoint*> encoded;
  std::string found;
  for (const TilePoint& point : tile.points) {
    if (!encoded.emplace(point.id, &point).second) {
      found += fmt::format("blob: point {} is in it twice\n", point.id.value());
    }
  }
  Statement points = db.Prepare("SELECT " MAPP_POINT_COLUMNS " FROM points p WHERE p.tile_id = ?");
  points.Bind(tile_id);
  for (;;) {
    MAPP_ASSIGN_OR_RETURN(const bool has_row, points.Step());
    if (!has_row) break;
    const StatusOr<PointRecord> point = ReadPoint(points);
    if (!point.ok()) continue;  // a finding of its own
    const auto entry = encoded.find(point->id);
    if (entry == encoded.end()) {
      found += fmt::format("blob: point {} is missing\n", point->id.value());
      continue;
    }
    if (const std::string what = Difference(*entry->second, *point, tile.edge_m); !what.empty()) {
      found += fmt::format("blob: point {} has another {}\n", point->id.value(), what);
    }
    encoded.erase(entry);
  }
  for (const auto& [id, point] : encoded) found += fmt::format("blob: point {} is not the tile's\n", id.value());
  return found;
}

StatusOr<std::string> BlobFault(Connection& db, const Statement& row) {
  const std::string_view blob = row.Bytes(3);
  if (row.IsNull(4) || row.IsNull(6)) return std::string("blob of a tile that does not exist");
  if (const uint32_t crc = Crc32c(blob); crc != row.Int64(2)) {
    return fmt::format("blob: crc32c {:#010x} != stored {:#010x}", crc, row.Int64(2));
  }
  const StatusOr<Tile> tile = DecodeTile(blob);
  if (!tile.ok()) return absl::StrCat("blob: ", tile.status().message());
  const int64_t revision = row.Int64(1);
  const int64_t tile_revision = row.Int64(5);
  if (revision > tile_revision) return fmt::format("blob of revision {}, the tile's is {}", revision, tile_revision);
  if (tile->key.Packed() != static_cast<uint64_t>(row.Int64(4)) || tile->edge_m != row.Double(6) ||
      tile->revision.value() != static_cast<uint64_t>(revision)) {
    return fmt::format("blob is of tile {} of edge {} m, revision {}", tile->key.ToString(), tile->edge_m,
                       tile->revision.value());
  }
  if (revision < tile_revision) return std::string();
  return ContentFault(db, row.Int64(0), *tile);
}

// Bounds are float32, rounded outwards by at most two steps of the last place; the map's id is a fourth axis.
#define MAPP_SQL_BOUND_IS(low, high, value_low, value_high)                            \
  "(i." low " <= " value_low " AND i." low " >= " value_low " - 5e-7 * abs(" value_low \
  ") - 1e-30 "                                                                         \
  "AND i." high " >= " value_high " AND i." high " <= " value_high " + 5e-7 * abs(" value_high ") + 1e-30)"

constexpr const char* kFrameIndex =
    "SELECT f.frame_id, 'is in the map and not in frame_index' FROM frames f LEFT JOIN frame_index i ON i.frame_id = "
    "f.frame_id WHERE f.in_map AND i.frame_id IS NULL UNION ALL "
    "SELECT i.frame_id, 'is in frame_index and not in the map' FROM frame_index i LEFT JOIN frames f ON f.frame_id = "
    "i.frame_id WHERE f.frame_id IS NULL OR NOT f.in_map UNION ALL "
    "SELECT i.frame_id, 'frame_index has it elsewhere' FROM frame_index i JOIN frames f ON f.frame_id = i.frame_id "
    "WHERE f.in_map AND NOT (" MAPP_SQL_BOUND_IS("map_min", "map_max", "f.map_id", "f.map_id") " AND "
    MAPP_SQL_BOUND_IS("x_min_m", "x_max_m", "f.tx_m", "f.tx_m") " AND "
    MAPP_SQL_BOUND_IS("y_min_m", "y_max_m", "f.ty_m", "f.ty_m") " AND "
    MAPP_SQL_BOUND_IS("z_min_m", "z_max_m", "f.tz_m", "f.tz_m") ")";

// Of the tile's indices as its key packs them.
#define MAPP_SQL_TILE_LOW(shift) "(((t.tile_key >> " shift ") & 2097151) - 1048576) * m.tile_edge_m AS "

constexpr const char* kTileIndex =
    "WITH cubes AS (SELECT t.tile_id, t.map_id, m.tile_edge_m AS edge_m, " MAPP_SQL_TILE_LOW("42") "x_m, "
    MAPP_SQL_TILE_LOW("21") "y_m, " MAPP_SQL_TILE_LOW("0") "z_m FROM tiles t JOIN maps m USING (map_id)) "
    "SELECT t.tile_id, 'is not in tile_index' FROM tiles t LEFT JOIN tile_index i ON i.tile_id = t.tile_id "
    "WHERE i.tile_id IS NULL UNION ALL "
    "SELECT i.tile_id, 'is in tile_index only' FROM tile_index i LEFT JOIN tiles t ON t.tile_id = i.tile_id "
    "WHERE t.tile_id IS NULL UNION ALL "
    "SELECT i.tile_id, 'tile_index has it elsewhere' FROM tile_index i JOIN cubes c ON c.tile_id = i.tile_id "
    "WHERE NOT (" MAPP_SQL_BOUND_IS("map_min", "map_max", "c.map_id", "c.map_id") " AND "
    MAPP_SQL_BOUND_IS("x_min_m", "x_max_m", "c.x_m", "(c.x_m + c.edge_m)") " AND "
    MAPP_SQL_BOUND_IS("y_min_m", "y_max_m", "c.y_m", "(c.y_m + c.edge_m)") " AND "
    MAPP_SQL_BOUND_IS("z_min_m", "z_max_m", "c.z_m", "(c.z_m + c.edge_m)") ")";

}  // namespace

std::vector<VerifyCheck> TileChecks() {
  return {
      {.name = "tiles", .what = "tile", .sql = kTileRows},
      {.name = "tile_counts", .what = "tile", .sql = kCounts},
      {.name = "tile_blobs", .what = "tile", .sql = kBlobs, .fault = BlobFault},
      {.name = "frame_index", .what = "frame", .sql = kFrameIndex},
      {.name = "tile_index", .what = "tile", .sql = kTileIndex},
  };
}

}  // namespace mapp::sqlite
