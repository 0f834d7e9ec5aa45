#pragma once

#include "mapp/base/status.h"
#include "mapp/map/tile.h"
#include "storage/records.h"

#include <span>
#include <vector>

namespace mapp {

class MapReader;

/// A frame that saw points of a tile, and whose it is: devices need not know the latter.
struct ObserverFrame : TileFrame {
  SessionId session;
};

/// A tile's points and the frames that observe them, as one snapshot has them.
struct TileContent {
  std::vector<PointRecord> points;
  std::vector<ObserverFrame> frames;  ///< every observer of `points`
};

StatusOr<TileContent> ReadTile(MapReader& reader, MapId map, const TileKey& key);

/// The tile as it is stored and sent (codec/tile_codec.h). At most 65536 frames: observers beyond them are left out.
Tile MakeTile(const TileKey& key, double edge_m, Revision revision, const TileContent& content);

/// Box strictly inside the tile's cube, for looking up that one tile among those that meet a box.
Aabb InnerBox(const TileKey& key, double edge_m);

}  // namespace mapp
