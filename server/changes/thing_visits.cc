#include "server/changes/thing_visits.h"

#include <algorithm>
#include <optional>

namespace mapp {
namespace {

/// Somebody may pass the same place twice: between views that saw a thing stay there is not more time than this.
constexpr int64_t kMaxBreakNs = 1'000'000'000;

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
                                                const std::map<SessionId, int64_t>& opened_ns, FindingsMaker& maker,
                                                const ThingVisitOptions& options) {
  std::vector<Looked> looked;
  double greatest_density = 0;
  const auto least = static_cast<double>(options.min_judged_points);
  const std::map<SessionId, PointCounts> counts = CountPoints(histories);
  const double least_judged = std::max(least, options.min_judged_share * static_cast<double>(histories.size()));
  for (const auto& [session, of_points] : counts) {
    const auto opened = opened_ns.find(session);
    if (opened == opened_ns.end() || of_points.num_judged() < least_judged) continue;
    MAPP_ASSIGN_OR_RETURN(Looked one, Look(points, session, maker, options.max_views));
    one.time_ns = opened->second;
    if (one.num_hits >= least) greatest_density = std::max(greatest_density, one.num_hits / one.area);
    looked.push_back(one);
  }
  std::vector<ThingVisit> visits;
  for (const Looked& one : looked) {
    if (one.num_views == 0) continue;
    const PresenceEvidence of_rays = EvidenceOfRays(one, greatest_density, options);
    const auto evidence = Combine(of_rays, counts.at(one.session), histories.size(), options);
    if (std::getenv("DEBUG_VISITS")) {
      const Eigen::Vector3d c = points.BoxMap().center();
      std::fprintf(stderr, "VISIT s%llu thing of %zu at %.1f %.1f %.1f: points %zu seen %zu missed; rays %.0f hits %.0f passed, %zu views, expected %.0f; evidence of rays %.1f %.1f -> %s %.1f %.1f\n", (unsigned long long)one.session.value(), points.p_map.size(), c.x(), c.y(), c.z(), counts.at(one.session).num_seen, counts.at(one.session).num_missed, one.num_hits, one.num_passed, one.num_views, one.NumExpected(options.least_density_share * greatest_density), of_rays.num_seen, of_rays.num_missed, evidence ? "" : "none", evidence ? evidence->num_seen : 0, evidence ? evidence->num_missed : 0);
    }
    if (!evidence || evidence->num_seen + evidence->num_missed < least) continue;
    visits.push_back({one.session, *evidence});
  }
  std::ranges::stable_sort(visits, {}, [](const ThingVisit& visit) { return visit.evidence.time_ns; });
  return visits;
}

StatusOr<std::optional<double>> StayInView(const ThingPoints& points, SessionId session, FindingsMaker& maker, size_t max_views) {
  MAPP_ASSIGN_OR_RETURN(auto views, maker.ViewsInto(session, points.BoxMap(), max_views));
  std::ranges::sort(views, {}, [](const auto& view) { return view->stamp_ns; });
  struct Stay {
    int64_t since_ns = 0, until_ns = 0;  ///< the present one
    int64_t longest_ns = -1;
    bool goes_on = false;
    int64_t in_view_since_ns = 0, in_view_until_ns = -1, in_view_ns = 0;
  };
  std::vector<Stay> stays(points.p_map.size());
  for (const auto& view : views) {
    const Pose3 T_camera_map = view->T_map_camera.Inverse();
    const PinholeCamera pinhole = view->camera.Undistorted();
    for (size_t i = 0; i < points.p_map.size(); ++i) {
      const Eigen::Vector3d p_camera = T_camera_map * points.p_map[i].cast<double>();
      if (p_camera.z() <= 0 || !view->camera.Contains(pinhole.Project(p_camera))) continue;
      if (p_camera.z() > view->geometry.farthest_depth_m()) continue;
      const SurfaceSighting sighting = view->geometry.At(p_camera.cast<float>());
      Stay& stay = stays[i];
      if (stay.in_view_until_ns < 0 || view->stamp_ns - stay.in_view_until_ns > kMaxBreakNs) stay.in_view_since_ns = view->stamp_ns;
      stay.in_view_until_ns = view->stamp_ns;
      stay.in_view_ns = std::max(stay.in_view_ns, stay.in_view_until_ns - stay.in_view_since_ns);
      if (sighting == SurfaceSighting::kMissed) stay.goes_on = false;
      if (sighting != SurfaceSighting::kSeen) continue;
      if (!stay.goes_on || view->stamp_ns - stay.until_ns > kMaxBreakNs) stay.since_ns = view->stamp_ns;
      stay.goes_on = true;
      stay.until_ns = view->stamp_ns;
      stay.longest_ns = std::max(stay.longest_ns, stay.until_ns - stay.since_ns);
    }
  }
  std::vector<double> shares;
  std::vector<int64_t> in_view_ns;
  for (const Stay& stay : stays) {
    if (stay.longest_ns < 0) continue;
    shares.push_back(static_cast<double>(stay.longest_ns) / std::clamp(static_cast<double>(stay.in_view_ns), .75e9, 3e9));
    in_view_ns.push_back(stay.in_view_ns);
  }
  if (shares.empty()) return std::nullopt;
  const auto middle = static_cast<std::ptrdiff_t>(shares.size() / 2);
  std::ranges::nth_element(in_view_ns, in_view_ns.begin() + middle);
  if (in_view_ns[static_cast<size_t>(middle)] < 400'000'000) return std::nullopt;
  std::ranges::nth_element(shares, shares.begin() + middle);
  return shares[static_cast<size_t>(middle)];
}

}  // namespace mapp
