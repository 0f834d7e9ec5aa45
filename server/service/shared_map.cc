#include "server/service/shared_map.h"

#include "mapp/base/bytes.h"
#include "mapp/codec/tile_codec.h"
#include "server/service/loaded_tile.h"
#include "server/service/look_ahead.h"
#include "server/service/serial_worker.h"
#include "server/service/tile_reader.h"
#include "storage/map_store.h"

#include <algorithm>
#include <chrono>
#include <optional>
#include <unordered_map>
#include <unordered_set>
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

/// What is to be looked at for a wish, in the order of sending.
struct WishedTiles {
  MapRecord map;
  /// With points, all around the view and the way ahead.
  std::unordered_map<TileKey, Revision> revisions;
  Aabb box_map;                ///< that they were looked up in
  std::vector<TileKey> order;  ///< those of `revisions` that are wished for
  size_t num_in_cone = 0;      ///< they come first
};

StatusOr<WishedTiles> FindTiles(MapStore& store, const SharedMapWish& wish) {
  const MapView& view = wish.view;
  ViewCone cone = view.Cone();
  cone.field_of_view *= wish.oversharing;
  MAPP_ASSIGN_OR_RETURN(const std::unique_ptr<MapReader> reader, store.Read());
  WishedTiles tiles;
  MAPP_ASSIGN_OR_RETURN(tiles.map, reader->GetMap(view.map));
  const TileGrid grid{tiles.map.tile_edge_m};
  const std::vector<TileKey> in_cone = TilesInView(cone, grid);
  std::vector<TileKey> ahead;
  tiles.box_map = cone.BoundingBox();
  if (wish.look_ahead.distance_m > 0) {
    MAPP_ASSIGN_OR_RETURN(
        const std::vector<WayPose> way,
        PredictWay(*reader, view, wish.look_ahead.motion, wish.look_ahead.distance_m, wish.look_ahead.earlier_ways));
    ahead = TilesAhead(way, view.Cone(), grid);
    for (const TileKey& key : ahead) tiles.box_map.extend(InnerBox(key, tiles.map.tile_edge_m));
  }
  MAPP_ASSIGN_OR_RETURN(const std::vector<TileRecord> records, reader->ListTiles(view.map, tiles.box_map));
  for (const TileRecord& record : records) {
    if (record.num_points > 0) tiles.revisions.emplace(record.key, record.revision);
  }
  std::unordered_set<TileKey> taken;
  const auto take = [&](const TileKey& key) {
    if (tiles.revisions.contains(key) && taken.insert(key).second) tiles.order.push_back(key);
  };
  std::ranges::for_each(in_cone, take);
  tiles.num_in_cone = tiles.order.size();
  // Nothing in view is new ground, whatever the map holds farther on.
  if (tiles.num_in_cone > 0) std::ranges::for_each(ahead, take);
  return tiles;
}

/// The tiles that a device told that it holds.
class HeldTiles {
 public:
  explicit HeldTiles(std::span<const HeldTile> held) : held_(held), is_settled_(held.size(), false) {
    for (size_t i = 0; i < held.size(); ++i) idx_.insert_or_assign(held[i].key, i);
  }

  /// That revision of the tile, if it may be what the device holds.
  std::optional<size_t> Find(const TileKey& key, Revision revision) const {
    const auto found = idx_.find(key);
    if (found == idx_.end() || held_[found->second].revision != revision) return std::nullopt;
    return found->second;
  }
  /// Whether the bytes are those that the device holds, as far as it told.
  bool HasBytes(size_t idx, const std::string& bytes) const {
    return !held_[idx].crc32c || *held_[idx].crc32c == Crc32c(bytes);
  }
  bool NeedsBytes(size_t idx) const { return held_[idx].crc32c.has_value(); }
  /// The device is told of it, or gets it anew.
  void Settle(const TileKey& key) {
    const auto found = idx_.find(key);
    if (found != idx_.end()) is_settled_[found->second] = true;
  }
  /// Those among the tiles looked up that are not as the map has them and were not settled.
  std::vector<uint32_t> Outdated(const WishedTiles& tiles) const {
    std::vector<uint32_t> outdated;
    for (size_t i = 0; i < held_.size(); ++i) {
      if (is_settled_[i] || !tiles.box_map.intersects(InnerBox(held_[i].key, tiles.map.tile_edge_m))) continue;
      const auto present = tiles.revisions.find(held_[i].key);
      if (present == tiles.revisions.end() || present->second != held_[i].revision) {
        outdated.push_back(static_cast<uint32_t>(i));
      }
    }
    return outdated;
  }

 private:
  std::span<const HeldTile> held_;
  std::vector<bool> is_settled_;
  std::unordered_map<TileKey, size_t> idx_;
};

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

StatusOr<SharedMapResult> SharedMapSender::Send(const CallContext& context, const SharedMapWish& wish,
                                                const std::function<Status(const std::string& tile)>& send) {
  MAPP_ASSIGN_OR_RETURN(const WishedTiles tiles, FindTiles(impl_->store, wish));
  HeldTiles held(wish.held_tiles);
  SharedMapResult result;
  result.map_revision = tiles.map.revision;
  uint64_t num_bytes = 0;
  for (size_t i = 0; i < tiles.order.size(); ++i) {
    MAPP_RETURN_IF_ERROR(context.Check());
    const TileKey& key = tiles.order[i];
    const std::optional<size_t> held_idx = held.Find(key, tiles.revisions.at(key));
    const auto note_unchanged = [&] {
      ++result.num_tiles_unchanged;
      result.unchanged_held.push_back(static_cast<uint32_t>(*held_idx));
      held.Settle(key);
    };
    if (held_idx && !held.NeedsBytes(*held_idx)) {
      note_unchanged();
      continue;
    }
    if (result.num_tiles_over_budget > 0 && !held_idx) {
      ++result.num_tiles_over_budget;
      continue;
    }
    MAPP_ASSIGN_OR_RETURN(std::optional<EncodedTile> tile,
                          ReadEncoded(impl_->store, {wish.view.map, tiles.map.tile_edge_m, key}));
    if (!tile) continue;
    if (held_idx && held.HasBytes(*held_idx, tile->blob.bytes)) {
      note_unchanged();
    } else if (result.num_tiles_over_budget > 0 ||
               (wish.max_bytes > 0 && num_bytes + tile->blob.bytes.size() > wish.max_bytes)) {
      ++result.num_tiles_over_budget;
    } else {
      MAPP_RETURN_IF_ERROR(send(tile->blob.bytes));
      num_bytes += tile->blob.bytes.size();
      ++result.num_tiles_sent;
      result.num_tiles_sent_ahead += i >= tiles.num_in_cone ? 1 : 0;
      held.Settle(key);
    }
    if (!tile->is_stored) impl_->blob_writer.Push({wish.view.map, key, std::move(tile->blob)});
  }
  result.outdated_held = held.Outdated(tiles);
  return result;
}

}  // namespace mapp
