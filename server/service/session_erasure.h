#pragma once

#include "mapp/base/call_context.h"
#include "mapp/base/status.h"
#include "storage/records.h"

#include <cstddef>

namespace mapp {

class MapWriter;

/// What went with a session.
struct SessionErasure {
  Revision revision;  ///< of the map; its oldest one now
  size_t num_points_kept = 0;
};

/// The last step of forgetting a session, within a transaction, of one that has no frame in its map. Points that frames
/// of others observe become those others', with a descriptor of theirs; the rest goes, and with it the map's readable
/// past. A founder hands the map on to the oldest session that stands in it. Errors are the writer's.
StatusOr<SessionErasure> EraseSession(MapWriter& writer, SessionId session);

}  // namespace mapp
