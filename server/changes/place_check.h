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

/// What the map's other points say of the place where a thing is said to have come or gone.
struct PlaceCount {
  size_t num_stayed = 0;           ///< points that were seen there both before and after
  std::vector<MapPointId> untold;  ///< seen before, and by nobody after: by id
};

/// Asks all findings about single places. Borrows what it is given.
class PlaceCheck {
 public:
  PlaceCheck(FindingsMaker& maker, std::span<const SessionFindings> findings,
             const std::map<SessionId, int64_t>& opened_ns);

  /// Of the points in `box_map`, made larger by `margin_m`. The event was between the openings of two sessions; some of
  /// those before and after, the nearest first, are asked.
  StatusOr<PlaceCount> Count(const OrientedBox& box_map, double margin_m, int64_t after_ns, int64_t before_ns) const;

 private:
  FindingsMaker& maker_;
  std::vector<std::pair<int64_t, const SessionFindings*>> by_time_;
};

}  // namespace mapp
