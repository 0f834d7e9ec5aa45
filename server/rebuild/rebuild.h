#pragma once

#include "mapp/base/call_context.h"
#include "mapp/base/status.h"

#include <cstdint>
#include <functional>
#include <string>
#include <vector>

namespace mapp {

struct RebuildProgress {
  int64_t num_done = 0, num_keyframes = 0;
};

struct RebuildOptions {
  /// Of the optimizations. With one, the same log gives the same database, bit for bit.
  int num_threads = 1;
  /// May be empty.
  std::function<void(const RebuildProgress&)> on_progress;
};

/// One map, as it was found and as it was made again.
struct RebuiltMap {
  std::string name;
  int64_t num_frames_before = 0, num_frames = 0;  ///< that stand in the map
  int64_t num_points_before = 0, num_points = 0;
  /// Between the camera centres of frames that stand in both; metres.
  double median_moved_m = 0, max_moved_m = 0;
  std::vector<std::string> dropped_tags;  ///< they name revisions that the new one does not have
};

struct RebuildReport {
  std::vector<RebuiltMap> maps;
  int64_t num_keyframes = 0;          ///< taken over
  std::vector<std::string> problems;  ///< keyframes that could not be, and what went wrong in the background
};

/// Makes frames, points, tiles and all else that is derived again from the keyframe log of the database `from`, into a
/// new one, `to`: keyframes are integrated one after the other in the log's order, at the times they were, and after
/// each is waited for what follows from it (DESIGN 11). Maps, sessions and frames keep their ids, devices find all as
/// they left it; what was judged is not judged again, and sessions that were reverted are taken out again. Revisions
/// and the ids of points are new, and tags are not taken over; nor are evidence and changes, which name points by id.
///
/// Beside a server that uses `from`, what it acknowledges meanwhile is missed. `to` appears whole or not at all.
/// ALREADY_EXISTS: there is a file `to`. CANCELLED. Others as OpenSqliteMapStore, read only.
StatusOr<RebuildReport> RebuildDatabase(const CallContext& context, const std::string& from, const std::string& to,
                                        const RebuildOptions& options);

}  // namespace mapp
