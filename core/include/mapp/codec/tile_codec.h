#pragma once

#include "mapp/base/status.h"
#include "mapp/map/tile.h"

#include <string>
#include <string_view>

namespace mapp {

/// The one byte format of a tile: stored, sent and cached as it is. docs/formats/tile.md.
/// Losses: position edge / 65535 (0.12 mm for 8 m), directions about 1 degree, reference distance 0.1 %, confidence
/// 1/255.
std::string EncodeTile(const Tile& tile);

/// DATA_LOSS when magic, version, length or checksum do not agree, or a field is out of range.
StatusOr<Tile> DecodeTile(std::string_view bytes);

/// Which tile the bytes are, without its points.
struct TileHeader {
  TileKey key;
  double edge_m = kDefaultTileEdgeM;
  Revision revision;
};
/// DATA_LOSS as DecodeTile, but for what is wrong among frames and points though the checksum agrees.
StatusOr<TileHeader> DecodeTileHeader(std::string_view bytes);

}  // namespace mapp
