#include "server/changes/thing_visits.h"

#include "mapp/codec/evidence_codec.h"

#include <algorithm>
#include <optional>
#include <utility>

namespace mapp {
namespace {

/// Sums over a session's views.
struct Looked {
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

/// What a visit's points say without its rays.
ThingVisit VisitByPoints(const TellingSession& one, const ThingVisitOptions& options) {
  // Where points are a sample, each stands for many.
  const double weight = one.has_views ? options.point_weight : 1.0;
  const double num_seen = weight * static_cast<double>(one.counts.num_seen);
  const double num_missed = weight * static_cast<double>(one.counts.num_missed);
  return {one.session, {one.opened_ns, num_seen, num_missed}, num_missed > num_seen};
}

StatusOr<Looked> Look(const ThingPoints& points, SessionId session, FindingsMaker& maker, size_t max_views) {
  Looked all;
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

PresenceEvidence EvidenceOfRays(const Looked& looked, int64_t time_ns, double greatest_density,
                                const ThingVisitOptions& options) {
  const double num_expected = looked.NumExpected(options.least_density_share * greatest_density);
  const double num_missed = std::max({0.0, looked.num_passed, num_expected - looked.num_hits});
  const double share =
      options.independent_views / std::max(options.independent_views, static_cast<double>(looked.num_views));
  return {time_ns, share * looked.num_hits, share * num_missed};
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

StatusOr<std::vector<TellingSession>> TellingSessions(const ThingPoints& points,
                                                      const std::map<SessionId, PointCounts>& counts,
                                                      const std::map<SessionId, int64_t>& opened_ns,
                                                      const std::set<SessionId>& reporting, FindingsMaker& maker,
                                                      const ThingVisitOptions& options) {
  const double least_judged = options.min_judged_share * static_cast<double>(points.p_map.size());
  std::vector<TellingSession> telling;
  for (const auto& [session, of_session] : counts) {
    const auto opened = opened_ns.find(session);
    if (opened == opened_ns.end()) continue;
    // Devices that tell without views tell of a sample.
    bool has_views = true;
    if (reporting.contains(session)) {
      MAPP_ASSIGN_OR_RETURN(const auto views, maker.ViewsInto(session, points.BoxMap(), /*max_views=*/1));
      has_views = !views.empty();
    }
    const double share = has_views ? 1.0 : 1.0 / kEvidenceOneIn;
    if (of_session.num_judged() < std::max(options.min_judged_points, share * least_judged)) continue;
    telling.push_back({session, opened->second, of_session, has_views});
  }
  std::ranges::stable_sort(telling, {}, &TellingSession::opened_ns);
  return telling;
}

std::vector<ThingVisit> VisitsByPoints(std::span<const TellingSession> telling, const ThingVisitOptions& options) {
  std::vector<ThingVisit> visits;
  for (const TellingSession& one : telling) visits.push_back(VisitByPoints(one, options));
  return visits;
}

StatusOr<std::vector<ThingVisit>> VisitsOfThing(const ThingPoints& points, std::span<const TellingSession> telling,
                                                int64_t event_ns, FindingsMaker& maker,
                                                const ThingVisitOptions& options) {
  const auto event = std::ranges::lower_bound(telling, event_ns, {}, &TellingSession::opened_ns);
  const auto a_side = static_cast<std::ptrdiff_t>(options.max_sessions_a_side);
  std::vector<std::optional<Looked>> looked;
  double greatest_density = 0;
  for (auto one = telling.begin(); one != telling.end(); ++one) {
    looked.emplace_back();
    if (!one->has_views || event - one > a_side || one - event >= a_side) continue;
    MAPP_ASSIGN_OR_RETURN(looked.back(), Look(points, one->session, maker, options.max_views));
    const Looked& rays = *looked.back();
    if (rays.num_hits >= options.min_judged_points) {
      greatest_density = std::max(greatest_density, rays.num_hits / rays.area);
    }
  }
  std::vector<ThingVisit> visits;
  for (size_t i = 0; i < telling.size(); ++i) {
    const TellingSession& one = telling[i];
    if (!looked[i]) {
      visits.push_back(VisitByPoints(one, options));
      continue;
    }
    if (looked[i]->num_views == 0) continue;
    const PresenceEvidence of_rays = EvidenceOfRays(*looked[i], one.opened_ns, greatest_density, options);
    const auto evidence = Combine(of_rays, one.counts, points.p_map.size(), options);
    if (!evidence || evidence->num_seen + evidence->num_missed < options.min_judged_points) continue;
    visits.push_back({one.session, *evidence, looked[i]->num_passed > looked[i]->num_hits});
  }
  return visits;
}

}  // namespace mapp
