#include "server/service/shared_map.h"

#include "mapp/codec/tile_codec.h"
#include "server/service/loaded_tile.h"
#include "server/service/serial_worker.h"
#include "server/service/tile_reader.h"
#include "storage/map_store.h"

#include <algorithm>
#include <chrono>
#include <optional>
#include <unordered_map>
#include <utility>
#include <vector>

namespace mapp {
namespace {

/// Encoded tiles that wait to be stored; about 1 MB each at most.
constexpr size_t kMaxWaitingBlobs = 64;

/// A tile of the map's grid, to be looked up at whatever revision it has then.
struct TileAddress {
  MapId map;
  double edge_m = kDefaultTileEdgeM;
  TileKey key;
};

struct EncodedTile {
  TileBlob blob;
  bool is_stored = false;
};

struct WaitingBlob {
  MapId map;
  TileKey key;
  TileBlob blob;
};

/// nullopt when the tile has no points.
StatusOr<std::optional<TileRecord>> FindTile(MapReader& reader, const TileAddress& tile) {
  MAPP_ASSIGN_OR_RETURN(const std::vector<TileRecord> records,
                        reader.ListTiles(tile.map, InnerBox(tile.key, tile.edge_m)));
  for (const TileRecord& record : records) {
    if (record.key == tile.key && record.num_points > 0) return record;
  }
  return std::optional<TileRecord>();
}

StatusOr<std::optional<EncodedTile>> ReadEncoded(MapStore& store, const TileAddress& tile) {
  MAPP_ASSIGN_OR_RETURN(const std::unique_ptr<MapReader> reader, store.Read());
  MAPP_ASSIGN_OR_RETURN(const std::optional<TileRecord> record, FindTile(*reader, tile));
  if (!record) return std::optional<EncodedTile>();
  StatusOr<std::optional<TileBlob>> stored = reader->GetTileBlob(tile.map, tile.key);
  // One that is damaged is made again of its points.
  if (!stored.ok() && !absl::IsDataLoss(stored.status())) return stored.status();
  if (stored.ok() && *stored && (*stored)->revision == record->revision) return EncodedTile{**std::move(stored), true};
  MAPP_ASSIGN_OR_RETURN(const TileContent content, ReadTile(*reader, tile.map, tile.key));
  return EncodedTile{{record->revision, EncodeTile(MakeTile(tile.key, tile.edge_m, record->revision, content))}, false};
}

struct MapTiles {
  MapRecord map;
  std::unordered_map<TileKey, Revision> revisions;
};

StatusOr<MapTiles> ListTiles(MapStore& store, MapId map, const Aabb& box_map) {
  MAPP_ASSIGN_OR_RETURN(const std::unique_ptr<MapReader> reader, store.Read());
  MapTiles tiles;
  MAPP_ASSIGN_OR_RETURN(tiles.map, reader->GetMap(map));
  MAPP_ASSIGN_OR_RETURN(const std::vector<TileRecord> records, reader->ListTiles(map, box_map));
  for (const TileRecord& record : records) {
    if (record.num_points > 0) tiles.revisions.emplace(record.key, record.revision);
  }
  return tiles;
}

}  // namespace

StatusOr<double> ShareSeenByOthers(TileCache& tiles, MapId map, const ViewCone& cone, SessionId session) {
  MAPP_ASSIGN_OR_RETURN(const auto in_reach, tiles.TilesInBox(map, cone.BoundingBox()));
  size_t num_points = 0, num_by_others = 0;
  for (const auto& tile : in_reach) {
    tile->ForEachPosition([&](const Eigen::Vector3f& p_map, const LoadedPoint& point) {
      if (!cone.Contains(p_map.cast<double>())) return;
      ++num_points;
      num_by_others += tile->IsSeenByOthers(point, session) ? 1 : 0;
    });
  }
  return num_points == 0 ? 0.0 : static_cast<double>(num_by_others) / static_cast<double>(num_points);
}

struct SharedMapSender::Impl {
  explicit Impl(MapStore& map_store)
      : store(map_store), blob_writer(kMaxWaitingBlobs, [this](const WaitingBlob& waiting) { StoreBlob(waiting); }) {}

  /// Only spares the next request the encoding: a full disk or a deleted map loses nothing, so errors end here.
  void StoreBlob(const WaitingBlob& waiting) {
    const CallContext context = CallContext::WithTimeout(std::chrono::seconds(10));
    const Status stored = store.Write(context, [&](MapWriter& writer) -> Status {
      // What has changed meanwhile may hold what was taken out of the map for good.
      MAPP_ASSIGN_OR_RETURN(const MapRecord map, writer.GetMap(waiting.map));
      MAPP_ASSIGN_OR_RETURN(const std::optional<TileRecord> tile,
                            FindTile(writer, {waiting.map, map.tile_edge_m, waiting.key}));
      if (!tile || tile->revision != waiting.blob.revision) return absl::OkStatus();
      const StatusOr<std::optional<TileBlob>> present = writer.GetTileBlob(waiting.map, waiting.key);
      if (!present.ok() && !absl::IsDataLoss(present.status())) return present.status();
      if (present.ok() && *present && (*present)->revision >= waiting.blob.revision) return absl::OkStatus();
      return writer.PutTileBlob(waiting.map, waiting.key, waiting.blob);
    });
    stored.IgnoreError();
  }

  MapStore& store;
  SerialWorker<WaitingBlob> blob_writer;
};

SharedMapSender::SharedMapSender(MapStore& store) : impl_(std::make_unique<Impl>(store)) {}
SharedMapSender::~SharedMapSender() = default;
void SharedMapSender::Shutdown() { impl_->blob_writer.Stop(); }

StatusOr<SharedMapResult> SharedMapSender::Send(const CallContext& context, const MapView& view, double oversharing,
                                                std::span<const HeldTile> held_tiles, uint64_t max_bytes,
                                                const std::function<Status(const std::string& tile)>& send) {
  ViewCone cone = view.Cone();
  cone.field_of_view *= oversharing;
  MAPP_ASSIGN_OR_RETURN(const MapTiles tiles, ListTiles(impl_->store, view.map, cone.BoundingBox()));
  std::unordered_map<TileKey, Revision> held;
  for (const HeldTile& tile : held_tiles) held.emplace(tile.key, tile.revision);

  SharedMapResult result;
  result.map_revision = tiles.map.revision;
  uint64_t num_bytes = 0;
  for (const TileKey& key : TilesInView(cone, {tiles.map.tile_edge_m})) {
    MAPP_RETURN_IF_ERROR(context.Check());
    const auto present = tiles.revisions.find(key);
    if (present == tiles.revisions.end()) continue;
    const auto held_tile = held.find(key);
    if (held_tile != held.end() && held_tile->second == present->second) {
      ++result.num_tiles_unchanged;
      continue;
    }
    if (result.num_tiles_over_budget > 0) {
      ++result.num_tiles_over_budget;
      continue;
    }
    MAPP_ASSIGN_OR_RETURN(std::optional<EncodedTile> tile,
                          ReadEncoded(impl_->store, {view.map, tiles.map.tile_edge_m, key}));
    if (!tile) continue;
    num_bytes += tile->blob.bytes.size();
    if (max_bytes > 0 && num_bytes > max_bytes) {
      ++result.num_tiles_over_budget;
    } else {
      MAPP_RETURN_IF_ERROR(send(tile->blob.bytes));
      ++result.num_tiles_sent;
    }
    if (!tile->is_stored) impl_->blob_writer.Push({view.map, key, std::move(tile->blob)});
  }
  return result;
}

}  // namespace mapp
