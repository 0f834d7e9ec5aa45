#include "server/changes/place_check.h"

#include <algorithm>
#include <utility>

namespace mapp {
namespace {

/// Sessions asked on either side: a map of years has many that say the same.
constexpr size_t kMaxSessions = 6;

bool HasSeen(const SessionFindings& findings, MapPointId point) {
  const auto found = std::ranges::lower_bound(findings.own, point, {}, &PointFinding::point);
  return found != findings.own.end() && found->point == point && found->num_seen > found->num_missed;
}

}  // namespace

PlaceCheck::PlaceCheck(FindingsMaker& maker, std::span<const SessionFindings> findings,
                       const std::map<SessionId, int64_t>& opened_ns)
    : maker_(maker) {
  for (const SessionFindings& of_session : findings) {
    const auto opened = opened_ns.find(of_session.session);
    if (opened != opened_ns.end()) by_time_.emplace_back(opened->second, &of_session);
  }
  std::ranges::sort(by_time_);
}

StatusOr<PlaceCount> PlaceCheck::Count(const OrientedBox& box_map, double margin_m, const EventTime& time) const {
  const auto opened = [](const auto& one) { return one.first; };
  const auto begin_before = std::ranges::lower_bound(by_time_, time.since_ns, {}, opened);
  const auto end_before = std::ranges::upper_bound(by_time_, time.after_ns, {}, opened);
  const auto begin_after = std::ranges::lower_bound(by_time_, time.before_ns, {}, opened);
  const auto end_after = std::ranges::upper_bound(by_time_, time.until_ns, {}, opened);
  const auto num_before = std::min<std::ptrdiff_t>(kMaxSessions, end_before - begin_before);
  const auto num_after = std::min<std::ptrdiff_t>(kMaxSessions, end_after - begin_after);
  const auto seen_by = [](auto first, std::ptrdiff_t num, MapPointId point) {
    return std::any_of(first, first + num, [&](const auto& one) { return HasSeen(*one.second, point); });
  };
  PlaceCount count;
  MAPP_ASSIGN_OR_RETURN(const auto tiles, maker_.PointsIn(box_map.BoundingBox(margin_m)));
  for (const auto& tile : tiles) {
    for (const SightedPoint& point : tile->points()) {
      if (!box_map.Contains(point.p_map.cast<double>(), margin_m)) continue;
      const bool was_seen = seen_by(end_before - num_before, num_before, point.id);
      const bool is_seen = seen_by(begin_after, num_after, point.id);
      if (was_seen && !is_seen) count.gone.push_back(point.id);
      count.num_stayed += was_seen && is_seen ? 1 : 0;
      count.num_came += !was_seen && is_seen ? 1 : 0;
    }
  }
  std::ranges::sort(count.gone);
  return count;
}

}  // namespace mapp
