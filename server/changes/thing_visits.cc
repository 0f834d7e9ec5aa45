#include "server/changes/thing_visits.h"

#include "mapp/codec/evidence_codec.h"

#include <algorithm>
#include <optional>
#include <utility>

namespace mapp {
namespace {

struct PointCounts {
  size_t num_seen = 0, num_missed = 0;
  double num_judged() const { return static_cast<double>(num_seen + num_missed); }
};

/// Sums over a session's views.
struct Looked {
  SessionId session;
  int64_t time_ns = 0;
  double num_hits = 0, num_passed = 0;
  double area = 0;  ///< of the outlines in all views
  struct View {
    double area = 0, num_blocked = 0;
  };
  size_t num_views = 0;
  std::vector<View> complete_views;

  /// Rays that should have ended at the thing, were it there: so many for its size in the images, but for those that
  /// ended before it.
  double NumExpected(double rays_per_area) const {
    double num_expected = 0;
    for (const View& view : complete_views) num_expected += std::max(0.0, rays_per_area * view.area - view.num_blocked);
    return num_expected;
  }
};

/// How many of the thing's points each session saw and missed.
std::map<SessionId, PointCounts> CountPoints(std::span<const PointHistory* const> histories) {
  std::map<SessionId, PointCounts> counts;
  for (const PointHistory* history : histories) {
    for (const PointHistory::Visit& visit : history->visits) {
      counts[visit.session].num_seen += visit.seen() ? 1 : 0;
      counts[visit.session].num_missed += visit.missed() ? 1 : 0;
    }
  }
  return counts;
}

/// Sessions that have judged enough of the thing, by the time they were opened: the nearest before the event and from
/// it on.
template <typename Tells>
std::vector<std::pair<int64_t, SessionId>> NearestTelling(const std::map<SessionId, PointCounts>& counts,
                                                          const Tells& tells,
                                                          const std::map<SessionId, int64_t>& opened_ns,
                                                          int64_t event_ns, size_t max_a_side) {
  std::vector<std::pair<int64_t, SessionId>> telling;
  for (const auto& [session, of_points] : counts) {
    const auto opened = opened_ns.find(session);
    if (opened == opened_ns.end() || !tells(session, of_points)) continue;
    telling.emplace_back(opened->second, session);
  }
  std::ranges::sort(telling);
  const auto event = std::ranges::lower_bound(telling, event_ns, {}, [](const auto& one) { return one.first; });
  const auto a_side = static_cast<std::ptrdiff_t>(max_a_side);
  const auto first = event - std::min(a_side, event - telling.begin());
  const auto end = event + std::min(a_side, telling.end() - event);
  return {first, end};
}

StatusOr<Looked> Look(const ThingPoints& points, SessionId session, FindingsMaker& maker, size_t max_views) {
  Looked all;
  all.session = session;
  MAPP_ASSIGN_OR_RETURN(const auto views, maker.ViewsInto(session, points.BoxMap(), max_views));
  for (const auto& view : views) {
    const ThingSighting sighting = SightThing(*view, points.p_map, points.directions);
    if (sighting.outline_area == 0) continue;
    ++all.num_views;
    all.area += sighting.outline_area;
    all.num_hits += static_cast<double>(sighting.num_hits);
    if (!view->complete) continue;
    all.num_passed += static_cast<double>(sighting.num_passed);
    all.complete_views.push_back({sighting.outline_area, static_cast<double>(sighting.num_blocked)});
  }
  return all;
}

PresenceEvidence EvidenceOfRays(const Looked& looked, double greatest_density, const ThingVisitOptions& options) {
  const double num_expected = looked.NumExpected(options.least_density_share * greatest_density);
  const double num_missed = std::max({0.0, looked.num_passed, num_expected - looked.num_hits});
  const double share =
      options.independent_views / std::max(options.independent_views, static_cast<double>(looked.num_views));
  return {looked.time_ns, share * looked.num_hits, share * num_missed};
}

/// nullopt: points and rays contradict each other, so that the visit tells nothing.
std::optional<PresenceEvidence> Combine(const PresenceEvidence& of_rays, const PointCounts& of_points,
                                        size_t num_points, const ThingVisitOptions& options) {
  const double telling = std::min(options.telling_points, options.telling_share * static_cast<double>(num_points));
  if (of_points.num_judged() < telling) return of_rays;
  const bool points_seen = of_points.num_seen > of_points.num_missed;
  if (points_seen != (of_rays.num_seen > of_rays.num_missed)) return std::nullopt;
  const double weight = 0.5 * options.point_weight;
  return PresenceEvidence{of_rays.time_ns, 0.5 * of_rays.num_seen + weight * static_cast<double>(of_points.num_seen),
                          0.5 * of_rays.num_missed + weight * static_cast<double>(of_points.num_missed)};
}

}  // namespace

Aabb ThingPoints::BoxMap() const {
  Aabb box_map;
  for (const Eigen::Vector3f& p : p_map) box_map.extend(p.cast<double>());
  return box_map;
}

StatusOr<std::vector<ThingVisit>> VisitsOfThing(const ThingPoints& points,
                                                std::span<const PointHistory* const> histories,
                                                const std::map<SessionId, int64_t>& opened_ns, int64_t event_ns,
                                                FindingsMaker& maker, const ThingVisitOptions& options) {
  std::vector<Looked> looked;
  double greatest_density = 0;
  const auto least = static_cast<double>(options.min_judged_points);
  const std::map<SessionId, PointCounts> counts = CountPoints(histories);
  const double least_judged = options.min_judged_share * static_cast<double>(histories.size());
  // Devices that tell without views tell of a sample.
  const auto tells = [&](SessionId session, const PointCounts& of_points) {
    const double share = maker.FramesOf(session).empty() ? 1.0 / kEvidenceOneIn : 1.0;
    return of_points.num_judged() >= std::max(least, share * least_judged);
  };
  for (const auto& [time_ns, session] :
       NearestTelling(counts, tells, opened_ns, event_ns, options.max_sessions_a_side)) {
    MAPP_ASSIGN_OR_RETURN(Looked one, Look(points, session, maker, options.max_views));
    one.time_ns = time_ns;
    if (one.num_hits >= least) greatest_density = std::max(greatest_density, one.num_hits / one.area);
    looked.push_back(one);
  }
  std::vector<ThingVisit> visits;
  for (const Looked& one : looked) {
    const PointCounts& of_points = counts.at(one.session);
    if (one.num_views == 0) {
      // Points are all that a device tells that uploads nothing (decision 0021). Of a session that uploads, frames that
      // do not see the thing tell nothing.
      if (!maker.FramesOf(one.session).empty()) continue;
      const auto num_seen = static_cast<double>(of_points.num_seen),
                 num_missed = static_cast<double>(of_points.num_missed);
      visits.push_back({one.session, {one.time_ns, num_seen, num_missed}, num_missed > num_seen});
      continue;
    }
    const PresenceEvidence of_rays = EvidenceOfRays(one, greatest_density, options);
    const auto evidence = Combine(of_rays, of_points, histories.size(), options);
    if (!evidence || evidence->num_seen + evidence->num_missed < least) continue;
    visits.push_back({one.session, *evidence, one.num_passed > one.num_hits});
  }
  return visits;
}

}  // namespace mapp
