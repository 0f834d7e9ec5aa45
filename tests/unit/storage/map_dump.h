#pragma once

#include "storage/map_store.h"

#include <string>

namespace mapp {

/// Everything that a reader says of a map, as text to compare: its record, sessions, frames with packets and
/// observations, points by session and by tile, references and revisions; without what has no history
/// (MapStore::ReadAsOf).
std::string DumpMap(MapReader& reader, MapId map);

/// Everything that a reader says of all maps: DumpMap of each, and what has no history.
std::string DumpAll(MapReader& reader);

}  // namespace mapp
