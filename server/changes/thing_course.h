#pragma once

#include "server/changes/place_check.h"
#include "server/changes/presence.h"
#include "server/changes/thing_visits.h"
#include "storage/records.h"

#include <cstdint>
#include <optional>
#include <span>
#include <vector>

namespace mapp {

/// Something that happened to a thing, as its visits tell.
struct Happening {
  ChangeKind kind = ChangeKind::kVanished;  ///< or kAppeared
  double confidence = 0;                    ///< that it was so at time.after_ns, and not so at time.before_ns
  EventTime time;
  int64_t first_seen_ns = 0, last_seen_ns = 0;
  std::vector<SessionId> sessions;   ///< whose visits tell of the state before and of that after, ascending
  std::vector<SessionId> seen_by;    ///< that saw the thing there, at any time: the nearest to the change first
  std::vector<SessionId> missed_by;  ///< that missed it next to the change, on its other side
};

/// What happened to a thing of this kind around `event_ns`, by the persistence posterior of its `visits` (by time).
/// nullopt: nothing; or it was there for one visit alone and not before or after, so that somebody passed; or it was
/// gone for one visit alone, whose rays do not say so.
std::optional<Happening> HappeningAt(std::span<const ThingVisit> visits, ChangeKind kind, int64_t event_ns,
                                     const PresenceOptions& options);

/// Makes the stay of a happening longer by `visits` (by time) before and after it that saw the thing as well, up to the
/// first that did not: more may tell of it than were asked what happened.
void ExtendStay(std::span<const ThingVisit> visits, Happening& happening);

}  // namespace mapp
