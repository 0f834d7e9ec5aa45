#include "server/service/tile_cache.h"

#include "mapp/base/mutex.h"
#include "server/service/loaded_tile.h"
#include "server/service/tile_reader.h"
#include "storage/map_store.h"

#include <algorithm>
#include <atomic>
#include <iterator>
#include <list>
#include <malloc.h>
#include <optional>
#include <thread>
#include <unordered_map>
#include <unordered_set>
#include <utility>

namespace mapp {
namespace {

using TilePtr = std::shared_ptr<const LoadedTile>;

struct CacheKey {
  MapId map;
  TileKey tile;
  friend bool operator==(const CacheKey&, const CacheKey&) = default;
};

struct CacheKeyHash {
  size_t operator()(const CacheKey& key) const {
    return std::hash<TileKey>()(key.tile) ^ (key.map.value() * 0x9e3779b97f4a7c15ULL);
  }
};

struct RevisedChange {
  Revision revision;
  TileChange change;
};

/// A tile while it is read from the store. What is committed meanwhile is kept, and put on top of what was read.
struct Load {
  std::vector<RevisedChange> changes;
  bool stale = false;  ///< invalidated meanwhile: what was read may be older than that
  bool done = false;
  bool succeeded = false;
  TilePtr tile;  ///< once it has succeeded
};

/// A tile in memory (`tile` null: it has no points), or one that is being loaded.
struct Entry {
  TilePtr tile;
  Revision revision;  ///< commits up to this one are in `tile`
  std::shared_ptr<Load> load;
  std::list<CacheKey>::iterator recency;
};

/// Which tiles of a map have points; may name tiles that have lost them since.
struct Directory {
  double edge_m = kDefaultTileEdgeM;
  bool loaded = false;
  std::unordered_set<TileKey> keys;
};

/// So many tiles that are not in memory are loaded by two threads.
constexpr size_t kMinAbsentForHelp = 2;
/// Of memory that tiles leave at once, from which on it is given back to the system.
constexpr size_t kMinTrimBytes = size_t{16} << 20;
constexpr size_t kEntryBytes = 160;        // of an entry without its tile, hash and list nodes included
constexpr size_t kDirectoryKeyBytes = 40;  // of a key in the directory

size_t BytesOf(const Entry& entry) { return kEntryBytes + (entry.tile == nullptr ? 0 : entry.tile->bytes()); }

struct Snapshot {
  Revision map_revision;
  TilePtr tile;
};

StatusOr<Snapshot> LoadFromStore(MapStore& store, const CacheKey& key) {
  MAPP_ASSIGN_OR_RETURN(const std::unique_ptr<MapReader> reader, store.Read());
  MAPP_ASSIGN_OR_RETURN(const MapRecord map, reader->GetMap(key.map));
  MAPP_ASSIGN_OR_RETURN(const TileContent content, ReadTile(*reader, key.map, key.tile));
  MAPP_ASSIGN_OR_RETURN(TilePtr tile, LoadedTile::Create(key.tile, map.revision, content.points, content.frames));
  return Snapshot{map.revision, std::move(tile)};
}

struct DirectoryContent {
  double edge_m = kDefaultTileEdgeM;
  std::vector<TileRecord> tiles;
};

StatusOr<DirectoryContent> ReadDirectory(MapStore& store, MapId map) {
  MAPP_ASSIGN_OR_RETURN(const std::unique_ptr<MapReader> reader, store.Read());
  MAPP_ASSIGN_OR_RETURN(const MapRecord record, reader->GetMap(map));
  MAPP_ASSIGN_OR_RETURN(std::vector<TileRecord> tiles, reader->ListTiles(map, std::nullopt));
  return DirectoryContent{record.tile_edge_m, std::move(tiles)};
}

StatusOr<TilePtr> ApplyTo(const TilePtr& tile, const TileChange& change, Revision revision) {
  if (tile != nullptr) return tile->With(change, revision);
  return LoadedTile::Create(change.key, revision, change.upserted, change.frames);
}

}  // namespace

struct TileCache::Impl {
  Impl(MapStore& map_store, size_t byte_limit) : store(map_store), max_bytes(byte_limit), limit(byte_limit) {}

  MapStore& store;
  const size_t max_bytes;

  mutable Mutex mutex;
  CondVar load_finished;
  std::unordered_map<CacheKey, Entry, CacheKeyHash> entries ABSL_GUARDED_BY(mutex);
  std::list<CacheKey> recency ABSL_GUARDED_BY(mutex);  // most recently used first; tiles in memory only
  std::unordered_map<MapId, Directory> directories ABSL_GUARDED_BY(mutex);
  size_t bytes ABSL_GUARDED_BY(mutex) = 0;
  size_t limit ABSL_GUARDED_BY(mutex);  ///< of `bytes`

  void Publish(const CacheKey& key, TilePtr tile, Revision revision) ABSL_EXCLUSIVE_LOCKS_REQUIRED(mutex);
  void DropOldest() ABSL_EXCLUSIVE_LOCKS_REQUIRED(mutex);
  void Erase(const CacheKey& key) ABSL_EXCLUSIVE_LOCKS_REQUIRED(mutex);
  void Touch(Entry& entry) ABSL_EXCLUSIVE_LOCKS_REQUIRED(mutex) {
    recency.splice(recency.begin(), recency, entry.recency);
  }
  void AddToDirectory(MapId map, const TileKey& key) ABSL_EXCLUSIVE_LOCKS_REQUIRED(mutex);
  void ApplyOne(MapId map, Revision revision, const TileChange& change) ABSL_EXCLUSIVE_LOCKS_REQUIRED(mutex);
  /// Whether the load's result became the tile; false when it has to be read again.
  StatusOr<bool> FinishLoad(const CacheKey& key, const std::shared_ptr<Load>& load, const Snapshot& snapshot)
      ABSL_EXCLUSIVE_LOCKS_REQUIRED(mutex);
  StatusOr<TilePtr> LoadTile(const CacheKey& key, std::shared_ptr<Load> load);
  /// Forgets a tile in memory; one that is being loaded is read again.
  void Drop(const CacheKey& key) ABSL_EXCLUSIVE_LOCKS_REQUIRED(mutex);
  void DropDirectory(MapId map) ABSL_EXCLUSIVE_LOCKS_REQUIRED(mutex);
  Status EnsureDirectory(MapId map);
  std::vector<TileKey> KeysInBox(MapId map, const Aabb& box_map);
  size_t NumAbsent(MapId map, const std::vector<TileKey>& keys) const;
};

void TileCache::Impl::Publish(const CacheKey& key, TilePtr tile, Revision revision) {
  Erase(key);
  Entry& entry = entries[key];
  entry.tile = std::move(tile);
  entry.revision = revision;
  recency.push_front(key);
  entry.recency = recency.begin();
  bytes += BytesOf(entry);
  DropOldest();
}

void TileCache::Impl::DropOldest() {
  while (bytes > limit && recency.size() > 1) {
    const CacheKey oldest = recency.back();
    Erase(oldest);
  }
}

void TileCache::Impl::Erase(const CacheKey& key) {
  const auto found = entries.find(key);
  if (found == entries.end()) return;
  if (found->second.load == nullptr) {
    bytes -= BytesOf(found->second);
    recency.erase(found->second.recency);
  }
  entries.erase(found);
}

void TileCache::Impl::AddToDirectory(MapId map, const TileKey& key) {
  // A directory that nobody has asked for yet will be read from the store.
  const auto directory = directories.find(map);
  if (directory != directories.end() && directory->second.keys.insert(key).second) bytes += kDirectoryKeyBytes;
}

void TileCache::Impl::Drop(const CacheKey& key) {
  const auto found = entries.find(key);
  if (found == entries.end()) return;
  if (found->second.load != nullptr) {
    found->second.load->stale = true;
  } else {
    Erase(key);
  }
}

void TileCache::Impl::DropDirectory(MapId map) {
  const auto directory = directories.find(map);
  if (directory == directories.end()) return;
  bytes -= directory->second.keys.size() * kDirectoryKeyBytes;
  directories.erase(directory);
}

void TileCache::Impl::ApplyOne(MapId map, Revision revision, const TileChange& change) {
  AddToDirectory(map, change.key);
  const CacheKey key{map, change.key};
  const auto found = entries.find(key);
  if (found == entries.end()) return;
  if (found->second.load != nullptr) {
    found->second.load->changes.push_back({revision, change});
    return;
  }
  // A snapshot taken between the commit and this call has the change already, and perhaps later ones.
  if (revision <= found->second.revision) return;
  StatusOr<TilePtr> changed = ApplyTo(found->second.tile, change, revision);
  if (changed.ok()) {
    Publish(key, *std::move(changed), revision);
  } else {
    Erase(key);  // the next use reads it from the store, and reports what is wrong
  }
}

StatusOr<bool> TileCache::Impl::FinishLoad(const CacheKey& key, const std::shared_ptr<Load>& load,
                                           const Snapshot& snapshot) {
  if (load->stale) {
    load->stale = false;
    load->changes.clear();  // the next snapshot is younger than all of them
    return false;
  }
  TilePtr tile = snapshot.tile;
  Revision revision = snapshot.map_revision;
  for (const RevisedChange& change : load->changes) {
    if (change.revision <= revision) continue;
    MAPP_ASSIGN_OR_RETURN(tile, ApplyTo(tile, change.change, change.revision));
    revision = change.revision;
  }
  Publish(key, std::move(tile), revision);
  return true;
}

StatusOr<TilePtr> TileCache::Impl::LoadTile(const CacheKey& key, std::shared_ptr<Load> load) {
  for (;;) {
    // The load is registered before the snapshot is taken: a commit that the snapshot lacks finds it.
    const StatusOr<Snapshot> snapshot = LoadFromStore(store, key);
    const MutexLock lock(mutex);
    StatusOr<bool> finished = snapshot.ok() ? FinishLoad(key, load, *snapshot) : snapshot.status();
    if (finished.ok() && !*finished) continue;
    if (finished.ok()) {
      load->tile = entries.at(key).tile;
      load->succeeded = true;
    } else {
      Erase(key);
    }
    load->done = true;
    load_finished.NotifyAll();
    if (!finished.ok()) return finished.status();
    return load->tile;
  }
}

Status TileCache::Impl::EnsureDirectory(MapId map) {
  {
    const MutexLock lock(mutex);
    // Registered before the snapshot is taken: keys of commits that the snapshot lacks join through Apply and
    // Invalidate.
    if (directories[map].loaded) return absl::OkStatus();
  }
  const StatusOr<DirectoryContent> content = ReadDirectory(store, map);
  const MutexLock lock(mutex);
  if (!content.ok()) {
    // An id is never given out again. After another error the keys collected so far are kept for the next attempt.
    if (absl::IsNotFound(content.status())) DropDirectory(map);
    return content.status();
  }
  for (const TileRecord& tile : content->tiles) AddToDirectory(map, tile.key);
  Directory& directory = directories[map];
  directory.edge_m = content->edge_m;
  directory.loaded = true;
  return absl::OkStatus();
}

std::vector<TileKey> TileCache::Impl::KeysInBox(MapId map, const Aabb& box_map) {
  const MutexLock lock(mutex);
  std::vector<TileKey> keys;
  const auto found = directories.find(map);
  if (found == directories.end() || box_map.isEmpty()) return keys;
  const Directory& directory = found->second;
  const TileGrid grid{directory.edge_m};
  const TileKey low = grid.KeyOf(box_map.min());
  const TileKey high = grid.KeyOf(box_map.max());
  const auto inside = [&](const TileKey& key) {
    return key.x >= low.x && key.x <= high.x && key.y >= low.y && key.y <= high.y && key.z >= low.z && key.z <= high.z;
  };
  const double num_cells = (high.x - low.x + 1.0) * (high.y - low.y + 1.0) * (high.z - low.z + 1.0);
  if (num_cells > static_cast<double>(directory.keys.size())) {
    std::copy_if(directory.keys.begin(), directory.keys.end(), std::back_inserter(keys), inside);
  } else {
    for (int32_t x = low.x; x <= high.x; ++x) {
      for (int32_t y = low.y; y <= high.y; ++y) {
        for (int32_t z = low.z; z <= high.z; ++z) {
          if (directory.keys.contains({x, y, z})) keys.push_back({x, y, z});
        }
      }
    }
  }
  std::sort(keys.begin(), keys.end());
  return keys;
}

size_t TileCache::Impl::NumAbsent(MapId map, const std::vector<TileKey>& keys) const {
  const MutexLock lock(mutex);
  return static_cast<size_t>(std::ranges::count_if(keys, [&](const TileKey& key) {
    return !entries.contains({map, key});
  }));
}

TileCache::TileCache(MapStore& store, size_t max_bytes) : impl_(std::make_unique<Impl>(store, max_bytes)) {}
TileCache::~TileCache() = default;

StatusOr<std::vector<std::shared_ptr<const LoadedTile>>> TileCache::TilesInBox(MapId map, const Aabb& box_map) {
  MAPP_RETURN_IF_ERROR(impl_->EnsureDirectory(map));
  const std::vector<TileKey> keys = impl_->KeysInBox(map, box_map);
  std::vector<StatusOr<TilePtr>> found(keys.size());
  std::atomic<size_t> next = 0;
  const auto get_rest = [&] {
    for (size_t i = next++; i < keys.size(); i = next++) found[i] = GetTile(map, keys[i]);
  };
  {
    // Tiles that have to be read from the store take a millisecond and more each.
    std::optional<std::jthread> helper;
    if (impl_->NumAbsent(map, keys) >= kMinAbsentForHelp) helper.emplace(get_rest);
    get_rest();
  }
  std::vector<TilePtr> tiles;
  for (StatusOr<TilePtr>& tile : found) {
    MAPP_RETURN_IF_ERROR(tile.status());
    if (*tile != nullptr) tiles.push_back(*std::move(tile));
  }
  return tiles;
}

StatusOr<std::shared_ptr<const LoadedTile>> TileCache::GetTile(MapId map, const TileKey& key) {
  const CacheKey cache_key{map, key};
  std::shared_ptr<Load> load;
  {
    const MutexLock lock(impl_->mutex);
    for (;;) {
      const auto found = impl_->entries.find(cache_key);
      if (found == impl_->entries.end()) break;
      if (found->second.load == nullptr) {
        impl_->Touch(found->second);
        return found->second.tile;
      }
      // Another caller is loading it. Should that fail, this one tries for itself. Its result is taken from the load:
      // the entry may have been dropped again before this thread has woken.
      const std::shared_ptr<Load> others = found->second.load;
      while (!others->done) impl_->load_finished.Wait(impl_->mutex);
      if (others->succeeded) return others->tile;
    }
    load = std::make_shared<Load>();
    impl_->entries[cache_key].load = load;
  }
  return impl_->LoadTile(cache_key, std::move(load));
}

void TileCache::Apply(MapId map, Revision revision, std::span<const TileChange> changes) {
  const MutexLock lock(impl_->mutex);
  for (const TileChange& change : changes) impl_->ApplyOne(map, revision, change);
}

void TileCache::Invalidate(MapId map, std::span<const TileKey> keys) {
  const MutexLock lock(impl_->mutex);
  for (const TileKey& key : keys) {
    impl_->AddToDirectory(map, key);
    impl_->Drop({map, key});
  }
}

void TileCache::OnMapDeleted(MapId map) {
  const MutexLock lock(impl_->mutex);
  std::vector<CacheKey> keys;
  for (const auto& [key, entry] : impl_->entries) {
    if (key.map == map) keys.push_back(key);
  }
  for (const CacheKey& key : keys) impl_->Drop(key);
  impl_->DropDirectory(map);
}

void TileCache::MakeRoomFor(size_t others_bytes) {
  const MutexLock lock(impl_->mutex);
  impl_->limit = std::max(impl_->max_bytes / 4, impl_->max_bytes - std::min(impl_->max_bytes, others_bytes));
  const size_t before = impl_->bytes;
  impl_->DropOldest();
  // What tiles leave are holes, too small for who needs the room.
  if (before - impl_->bytes > kMinTrimBytes) malloc_trim(0);
}

size_t TileCache::bytes() const {
  const MutexLock lock(impl_->mutex);
  return impl_->bytes;
}

}  // namespace mapp
