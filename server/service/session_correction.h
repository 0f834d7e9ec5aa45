#pragma once

#include "mapp/base/call_context.h"
#include "server/service/merger.h"

namespace mapp {

/// Moves a session that is in the map to a better place and scale, in one transaction: its frames, and the points that
/// no other session has seen. Afterwards drops the touched tiles, and publishes TilesChanged to the map and
/// SessionCorrected to the session. Does nothing when the session is not aligned, or quarantined. Errors: NOT_FOUND for
/// a deleted session, ABORTED when the map has another unit than `placement` was found in, else the store's.
Status CorrectSession(MapStore& store, TileCache& tiles, SessionEvents& events, const CallContext& context,
                      SessionId session, const Placement& placement);

}  // namespace mapp
