#pragma once

#include "mapp/base/status.h"
#include "storage/records.h"
#include "storage/sqlite/connection.h"

#include <string>
#include <vector>

namespace mapp::sqlite {

// What the place index keeps. Promises: storage/map_store.h.

StatusOr<std::vector<std::string>> ListPlaceBlocks(Connection& db, MapId map);
Status AppendPlaceBlock(Connection& db, MapId map, const std::string& block);

}  // namespace mapp::sqlite
