#pragma once

#include "mapp/base/status.h"
#include "mapp/map/tile.h"
#include "storage/records.h"

#include <set>
#include <vector>

namespace mapp {

class MapWriter;

/// What a retirement did to the map.
struct Retirement {
  Revision revision;  ///< of the map; 0 when there was nothing to retire
  std::vector<FrameId> frames;
  size_t num_points = 0;
  std::vector<TileKey> touched_tiles;
  std::set<SessionId> neighbors;  ///< other sessions with frames that are listed as observers of points it shared
};

/// Takes the session's frames from keyframe `first` on out of the map, at a new revision made for `cause`: they stay in
/// the keyframe log, in the session's frame and without observations. The session's points that no frame left in the
/// map observes are retired; the others lose these observations again (point_stats.h, RemoveObservation). Errors are
/// the writer's.
StatusOr<Retirement> RetireFrames(MapWriter& writer, const SessionRecord& session, uint32_t first, RevisionCause cause);

}  // namespace mapp
