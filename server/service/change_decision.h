#pragma once

#include "mapp/base/status.h"
#include "mapp/map/tile.h"
#include "storage/records.h"

#include <set>
#include <span>
#include <vector>

namespace mapp {

class MapStore;
class MapWriter;

/// What a decision on changes of the world did to the map.
struct ChangeDecision {
  std::vector<ChangeRecord> changes;  ///< as they are now, by id
  Revision revision;                  ///< 0: frames and points stay as they were
  size_t num_points = 0;              ///< retired, or returned
  std::set<TileKey> touched_tiles;
};

/// The change, of this map. NOT_FOUND: another map's, or none.
StatusOr<ChangeRecord> GetChangeOf(MapWriter& writer, const MapRecord& map, ChangeId change);

/// Accepts changes and applies them to the map at one new revision: points of things that are no more where they were
/// are retired. Frames keep their observations of them, as of all points that end. Those that are accepted already are
/// left alone. FAILED_PRECONDITION: one is rejected.
StatusOr<ChangeDecision> AcceptChanges(MapWriter& writer, const MapRecord& map, std::span<const ChangeId> ids);

/// FAILED_PRECONDITION: one is accepted.
StatusOr<ChangeDecision> RejectChanges(MapWriter& writer, const MapRecord& map, std::span<const ChangeId> ids);

/// Proposes changes again; points that acceptance retired live again as they were before it. OUT_OF_RANGE: that cannot
/// be read any more. `store`: the writer's, to read the past from.
StatusOr<ChangeDecision> UndoChanges(MapWriter& writer, MapStore& store, const MapRecord& map,
                                     std::span<const ChangeId> ids);

}  // namespace mapp
