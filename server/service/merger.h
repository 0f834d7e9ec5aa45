#pragma once

#include "mapp/base/call_context.h"
#include "server/service/session_events.h"
#include "storage/map_store.h"

#include <unordered_map>

namespace mapp {

class TileCache;

/// Points of a fragment and the map points they were found to be.
using PointFusions = std::unordered_map<MapPointId, MapPointId>;

/// Compares every keyframe of the fragment with the map under `T_map_session` and pairs its points with map points: by
/// projection, descriptor, viewing direction, and a distance within PointTolerance(). A point that several map points
/// fit goes to the one most keyframes chose. Errors are the reader's.
StatusOr<PointFusions> FindFusions(MapReader& reader, SessionId session, const Pose3& T_map_session);

/// Moves a fragment into the map in one transaction: its frames and points to the map's frame, including those stored
/// since the alignment was found; paired points fused into the map's. Afterwards drops the touched tiles from `tiles`
/// and publishes TilesChanged to the map and SessionAligned to the session.
/// Does nothing when the session is aligned already, or quarantined. Errors: NOT_FOUND for a deleted session, else the
/// store's.
Status MergeFragment(MapStore& store, TileCache& tiles, SessionEvents& events, const CallContext& context,
                     SessionId session, const Pose3& T_map_session, const PointFusions& fusions);

}  // namespace mapp
