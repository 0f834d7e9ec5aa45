#pragma once

#include "mapp/base/status.h"
#include "mapp/geometry/pose3.h"
#include "storage/records.h"

#include <optional>
#include <utility>
#include <vector>

namespace mapp {

class MapReader;
class MapWriter;
class SessionEvents;
class TileCache;

/// Median depth of the views of a map of unknown scale, in its units: what is told in metres all over the service
/// (tiles, search radii, tolerances) was chosen for rooms and halls, which a camera sees from about so far.
inline constexpr double kNominalDepthM = 3;

/// A map that was given another unit of length.
struct RescaledMap {
  std::vector<std::pair<SessionId, Sim3>> sessions;  ///< those in the map, with their new S_map_session
  std::vector<TileKey> touched_tiles;                ///< those that held points before, and those that do now
};

/// Within a transaction: multiplies all lengths of a map by `scale` at a new revision: frames, points and where
/// sessions lie. Takes as long as the map is large. Errors: the writer's.
StatusOr<RescaledMap> RescaleMap(MapWriter& writer, const MapRecord& map, double scale);

/// Within a transaction, after a frame of `session` has joined the map: gives a map of unknown scale another unit where
/// its founder's views are off kNominalDepthM by more than half, the first having been of something near, say. Looks
/// only at the founder's frames, at each doubling of their number: others have begun to count on the unit, and all of
/// it costs no more than a few times what the frames do. nullopt: the map is as it was. Errors: the writer's.
StatusOr<std::optional<RescaledMap>> KeepNominalScale(MapWriter& writer, const SessionRecord& session);

/// After the commit: drops the tiles, and publishes TilesChanged to the map and SessionCorrected to its sessions.
void AnnounceRescaled(TileCache& tiles, SessionEvents& events, MapId map, Revision revision,
                      const RescaledMap& rescaled);

/// A number that changes with a map's unit of length, and with nothing else: what was measured in a map under another
/// one is of no use. Errors: the reader's.
StatusOr<double> UnitOf(MapReader& reader, MapId map);

}  // namespace mapp
