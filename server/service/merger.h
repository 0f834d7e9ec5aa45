#pragma once

#include "mapp/base/call_context.h"
#include "server/service/session_events.h"
#include "storage/map_store.h"

#include <unordered_map>

namespace mapp {

class TileCache;

/// Points of a fragment and the map points they were found to be.
using PointFusions = std::unordered_map<MapPointId, MapPointId>;

/// Where a fragment lies.
struct Placement {
  Sim3 S_map_session;
  double map_unit = 1;  ///< UnitOf(the map) when that was found
};

/// Compares every keyframe of the fragment with the map under `S_map_session` and pairs its points with map points: by
/// projection, descriptor, viewing direction, and a distance within PointTolerance(). A point that several map points
/// fit goes to the one most keyframes chose. Errors are the reader's.
StatusOr<PointFusions> FindFusions(MapReader& reader, SessionId session, const Sim3& S_map_session);

/// Moves a fragment into the map in one transaction: its frames and points to the map's frame, including those stored
/// since the alignment was found; paired points fused into the map's. Afterwards drops the touched tiles from `tiles`
/// and publishes TilesChanged to the map and SessionAligned to the session. The first session in metres that joins a
/// map of unknown scale sets it: the map is rescaled in the same transaction, and SessionCorrected published to the
/// sessions in it. Does nothing when the session is aligned already, or quarantined. Errors: NOT_FOUND for a deleted
/// session, ABORTED when the map has been rescaled since the alignment was found, else the store's.
Status MergeFragment(MapStore& store, TileCache& tiles, SessionEvents& events, const CallContext& context,
                     SessionId session, const Placement& placement, const PointFusions& fusions);

}  // namespace mapp
