#pragma once

#include "mapp/base/call_context.h"
#include "mapp/base/status.h"
#include "storage/records.h"

#include <cstdint>
#include <functional>
#include <optional>
#include <string>

namespace mapp {

class MapStore;

/// What of a map's history is to stay. With both, whatever one of them needs; with none, nothing is dropped.
struct CompactionRequest {
  std::string map_name;
  std::optional<uint64_t> keep_revisions;  ///< before the present one
  std::optional<double> keep_days;         ///< the state of that time ago, and all since
  bool dry_run = false;
  bool rewrite = false;  ///< the store, afterwards (MapStore::Rewrite)
};

struct Compaction {
  Revision oldest_before, oldest;     ///< that can be read
  std::optional<TagRecord> kept_for;  ///< the tag without which more would go
  int64_t num_rows = 0;               ///< of history, dropped or to be dropped
  int64_t num_bytes_given_back = 0;   ///< to the system; what was unused before is among it
};

/// How far a compaction is.
struct CompactionProgress {
  int64_t rows_done = 0, rows_total = 0;
  int64_t bytes_left = 0;  ///< to give back, once all rows are gone
};
using CompactionObserver = std::function<void(const CompactionProgress&)>;

/// Drops what no retained revision needs and gives the space back, in small changes beside the live traffic. Tagged
/// revisions stay, and all after them. `now_ns`: Unix time. Ended in the middle, the next one goes on. NOT_FOUND: no
/// such map; INVALID_ARGUMENT: nothing said of what to keep; CANCELLED or DEADLINE_EXCEEDED of `context`.
StatusOr<Compaction> CompactMap(MapStore& store, const CallContext& context, const CompactionRequest& request,
                                int64_t now_ns, const CompactionObserver& on_progress);

}  // namespace mapp
