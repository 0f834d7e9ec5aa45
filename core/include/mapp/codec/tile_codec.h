#pragma once

#include <string>
#include <string_view>

#include "mapp/base/status.h"
#include "mapp/map/tile.h"

namespace mapp {

/// The one byte format of a tile: stored, sent and cached as it is. docs/formats/tile.md.
/// Losses: position 1 mm within the tile, directions 1 degree, reference distance 1 %, confidence 1/255.
std::string EncodeTile(const Tile& tile);

/// DATA_LOSS when magic, version, length or checksum do not agree, or a field is out of range.
StatusOr<Tile> DecodeTile(std::string_view bytes);

}  // namespace mapp
