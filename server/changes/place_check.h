#pragma once

#include "mapp/base/status.h"
#include "mapp/geometry/oriented_box.h"
#include "server/changes/session_findings.h"
#include "storage/records.h"

#include <cstdint>
#include <map>
#include <span>
#include <vector>

namespace mapp {

/// When a thing came or went, by openings of sessions, Unix time.
struct EventTime {
  int64_t since_ns = 0;                 ///< it had been as before since then,
  int64_t after_ns = 0, before_ns = 0;  ///< it changed between these,
  int64_t until_ns = 0;                 ///< and stayed so until then
};

/// What the map's points say of the place where a thing is said to have come or gone.
struct PlaceCount {
  size_t num_stayed = 0;         ///< points that were seen there both before and after
  size_t num_came = 0;           ///< seen after, and by nobody before
  std::vector<MapPointId> gone;  ///< seen before, and by nobody after: by id
};

/// Asks all findings about single places. Borrows what it is given.
class PlaceCheck {
 public:
  PlaceCheck(FindingsMaker& maker, std::span<const SessionFindings> findings,
             const std::map<SessionId, int64_t>& opened_ns);

  /// Of the points in `box_map`, made larger by `margin_m`: the nearest of the sessions before the event and after it
  /// are asked.
  StatusOr<PlaceCount> Count(const OrientedBox& box_map, double margin_m, const EventTime& time) const;

 private:
  FindingsMaker& maker_;
  std::vector<std::pair<int64_t, const SessionFindings*>> by_time_;
};

}  // namespace mapp
