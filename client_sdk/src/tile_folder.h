#pragma once

#include "mapp/base/id.h"
#include "mapp/base/status.h"
#include "mapp/client/participant.h"
#include "mapp/map/tile.h"

#include <cstdint>
#include <filesystem>
#include <memory>
#include <optional>
#include <string>
#include <string_view>
#include <vector>

namespace mapp {

/// Tells a map from others of its name, at this server and elsewhere, before and after.
struct MapIdentity {
  MapId id;
  int64_t created_ns = 0;  ///< Unix time
};

/// Encoded tiles of one map on disk (docs/formats/tile_cache.md): a file each, in a folder that several devices and
/// maps may share. Files appear whole or not at all; beyond the size limit those used least lately are removed,
/// whichever map they are of. What it gives may be damaged or old, as files are: it is for the reader to check.
/// One thread only; other instances, here and in other processes, may use the same folder at the same time.
class TileFolder {
 public:
  /// Makes the folder if it is not there and writes into it for a try. FAILED_PRECONDITION naming it: it cannot be made
  /// or written, or is no folder.
  static Status CheckUsable(const TileCacheOptions& options);
  /// Removes what writers that were killed have left behind. Errors as CheckUsable.
  static StatusOr<std::unique_ptr<TileFolder>> Open(const TileCacheOptions& options, const MapIdentity& map);

  /// All tiles of the map that are there.
  std::vector<TileKey> Keys() const;
  /// nullopt when it is not there or cannot be read. Counts as use.
  std::optional<std::string> Read(const TileKey& key) const;
  /// Replaces what is there. RESOURCE_EXHAUSTED, FAILED_PRECONDITION: it cannot be written; what was there stays.
  Status Write(const TileKey& key, std::string_view bytes);
  void Remove(const TileKey& key);

 private:
  TileFolder(const TileCacheOptions& options, const MapIdentity& map);

  std::filesystem::path FileOf(const TileKey& key) const;
  /// Of all maps.
  void RemoveLeastUsed();

  const std::filesystem::path root_;
  const std::filesystem::path folder_;  ///< the map's
  const uint64_t max_bytes_;
  uint64_t bytes_since_look_ = 0;  ///< written since all files were looked at
  uint64_t bytes_at_look_ = 0;     ///< of all files then
};

}  // namespace mapp
