#pragma once

#include "eval/metrics/overlap_oracle.h"
#include "mapp/base/status.h"
#include "server/service/tile_cache.h"
#include "storage/records.h"

#include <memory>
#include <set>
#include <vector>

namespace mapp {

class MapStore;

/// A map as some of its sessions have made it, for the service to search and for an oracle to know.
struct StudyMap {
  MapRecord record;
  std::unique_ptr<TileCache> tiles;  ///< all in memory, never dropped: the store's own hold more
  std::vector<SeenPoint> points;     ///< the same points, with all their observers
};

/// The map without what the sessions in `without` have brought: their frames observe nothing, and points that only they
/// have observed are not there. What the others' points owe to them (an optimisation that they took part in) stays.
/// `store` must outlive the result. Errors are the store's.
StatusOr<StudyMap> LoadMapWithout(MapStore& store, const MapRecord& map, const std::set<SessionId>& without);

}  // namespace mapp
