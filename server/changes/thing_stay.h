#pragma once

#include "server/changes/session_findings.h"
#include "server/changes/thing_visits.h"

#include <cstddef>
#include <cstdint>
#include <optional>
#include <span>

namespace mapp {

/// Whether something stands or passes is told by time, of which a mapped point keeps nothing: people in an aisle are at
/// the same places on every visit, but never stay there.
struct StayOptions {
  size_t max_views = 64;    ///< asked of a session, the nearest first
  size_t max_sessions = 5;  ///< asked of a thing
  /// What stands is seen for this share of the time that its place is in view, over the median of its points. In
  /// simulated garages and halls it was 0.75 and more of what stood, and at most 0.6 of people who walked by.
  double min_share = 0.65;
  /// The time in view is taken to be at least so long (a glimpse is no proof) and at most so long (it may be hidden
  /// before and after); of less than `too_short_s` nothing is said.
  double least_view_s = 0.75;
  double greatest_view_s = 3;
  double too_short_s = 0.4;
  /// Somebody may pass a place twice: between views that show a stay there is no more time than this.
  double max_break_s = 1;
};

/// Share of the time in view for which one session saw the thing's points where they are, without a break, the median
/// over those that it saw at all; nullopt when it saw none, or too shortly to tell.
StatusOr<std::optional<double>> ShareOfStay(const ThingPoints& points, SessionId session, FindingsMaker& maker,
                                            const StayOptions& options);

/// Whether the thing stood there for most of the sessions that saw it: of `seen_by`, those first in it that can tell.
/// No when none can.
StatusOr<bool> IsStanding(const ThingPoints& points, std::span<const SessionId> seen_by, FindingsMaker& maker,
                          const StayOptions& options);

}  // namespace mapp
