#pragma once

#include "storage/records.h"

#include <cstdint>
#include <span>
#include <vector>

namespace mapp {

/// What is to be written so that the stored changes say what was found.
struct ChangeUpdate {
  std::vector<ChangeRecord> known;  ///< found again, with the ids and what was decided of them
  std::vector<ChangeRecord> fresh;  ///< without an id
  std::vector<ChangeId> dropped;    ///< proposed, in that time, and not found again
};

/// Whether two records tell of the same event: kind (of what moved one half may be all that is told), a time in which
/// both may have happened, and either half of the points of the one that has fewer or boxes of which one has its centre
/// in the other.
bool IsSameEvent(const ChangeRecord& a, const ChangeRecord& b);

/// Compares what was found in the sessions of [from_ns, to_ns] with what is stored of the map. A proposal takes over
/// what is known now; what was decided stays as it was decided, also where nothing tells of it any more (an accepted
/// removal has taken its points away).
ChangeUpdate MatchChanges(std::span<const ChangeRecord> stored, std::vector<ChangeRecord> found, int64_t from_ns,
                          int64_t to_ns);

}  // namespace mapp
