#pragma once

#include "mapp/base/call_context.h"
#include "server/service/loop.h"
#include "server/service/optimizer_region.h"

namespace mapp {

/// The poses that a loop concerns, as a region whose problem has no observations: the session's frames, and those that
/// share points with it, and with those, up to a bound; what lies beyond stays in place. Linked are frames that follow
/// each other in a session and frames that share many points, by the relative poses that the map has now (the essential
/// graph of Mur-Artal et al., ORB-SLAM, 2015), and the loop's matches by theirs. Points are carried by the frame that
/// mapped them.
struct LoopGraph {
  OptimizerRegion region;
  size_t num_matches = 0;
};

/// Errors: the reader's, and CANCELLED or DEADLINE_EXCEEDED of `context`.
StatusOr<LoopGraph> LoadLoopGraph(const CallContext& context, MapReader& reader, const Loop& loop);

/// By how many sigmas a link is off, in the frames' present poses: the root mean square of its six coordinates.
double LinkError(const BundleProblem& problem, const BundleProblem::RelativePose& link);

}  // namespace mapp
