#pragma once

#include "mapp/base/call_context.h"
#include "mapp/base/status.h"
#include "server/service/loop.h"

#include <optional>

namespace mapp {

class MapStore;
class SessionEvents;
class TileCache;

/// Spreads what a loop tells over the way that led there: a graph of the map's poses around the session
/// (loop_graph.h) is relaxed, and frames, and points with the frame that mapped them, go to their new places in one
/// transaction, sessions that were aligned along the way included. Publishes TilesChanged to the map and
/// SessionCorrected to the sessions that were moved.
///
/// nullopt, and nothing changed, when the poses on the way resist: then the loop is none. Also when frames go on
/// being moved meanwhile: the next visit will tell again. Errors: NOT_FOUND for a map deleted meanwhile, CANCELLED or
/// DEADLINE_EXCEEDED of `context`, else the store's.
StatusOr<std::optional<ClosedLoop>> CloseLoop(MapStore& store, TileCache& tiles, SessionEvents& events,
                                              const CallContext& context, const Loop& loop);

/// Fuses what the visit shows twice, after its loop was closed; the number of points that became another one.
StatusOr<uint32_t> FuseVisit(MapStore& store, TileCache& tiles, SessionEvents& events, const CallContext& context,
                             const Loop& loop);

}  // namespace mapp
