#include "server/changes/thing_groups.h"

#include "mapp/base/parallel.h"
#include "mapp/geometry/neighbor_grid.h"

#include <algorithm>
#include <compare>
#include <functional>
#include <limits>
#include <map>
#include <numeric>
#include <set>
#include <utility>

namespace mapp {
namespace {

/// Of the sessions that found one of two points of one thing there (and of those that found one gone) at least so many
/// say the same of the other.
constexpr double kMinAgreement = 0.75;

// Of SplitAtNecks, for things of so many points: those with as many neighbours within kDensityRadiusM as kCoreDensity
// of the median are core points; core points further apart than kCoreGapM belong to different parts, if these have at
// least kLeastPart of them.
constexpr size_t kMinSplitPoints = 150;
constexpr float kDensityRadiusM = 0.25F;
constexpr double kCoreDensity = 0.1;
constexpr float kCoreGapM = 0.25F;
constexpr size_t kLeastPart = 50;

class Forest {
 public:
  explicit Forest(size_t size) : parents_(size) { std::iota(parents_.begin(), parents_.end(), size_t{0}); }
  size_t RootOf(size_t i) {
    while (parents_[i] != i) i = parents_[i] = parents_[parents_[i]];
    return i;
  }
  void Join(size_t a, size_t b) {
    const size_t root_a = RootOf(a), root_b = RootOf(b);
    parents_[std::max(root_a, root_b)] = std::min(root_a, root_b);
  }

 private:
  std::vector<size_t> parents_;
};

/// For each event, the points that may have come or gone by it.
std::map<GroupEvent, std::vector<PointChange>> PointsOfEvents(std::span<const PointCourse> courses) {
  std::set<SessionId> sessions;
  for (const PointCourse& course : courses) {
    for (const PointCourse::Visit& visit : course.visits) sessions.insert(visit.session);
  }
  std::map<GroupEvent, std::vector<PointChange>> events;
  for (size_t i = 0; i < courses.size(); ++i) {
    const std::vector<PointCourse::Visit>& visits = courses[i].visits;
    for (size_t k = 0; k + 1 < visits.size(); ++k) {
      if (!courses[i].ChangesAfter(k) || courses[i].Around(k).empty()) continue;
      const auto end = sessions.upper_bound(visits[k + 1].session);
      for (auto session = sessions.upper_bound(visits[k].session); session != end; ++session) {
        events[{*session, visits[k + 1].is_there}].push_back({i, k});
      }
    }
  }
  return events;
}

/// Those of the points that hang together.
std::vector<std::vector<PointChange>> Linked(std::span<const PointCourse> courses,
                                             std::span<const Eigen::Vector3f> p_map,
                                             const std::vector<PointChange>& points, float gap_m, size_t min_points) {
  std::vector<Eigen::Vector3f> positions;
  std::vector<std::span<const PointCourse::Visit>> around;
  for (const PointChange& one : points) {
    positions.push_back(p_map[one.point]);
    around.push_back(courses[one.point].Around(one.visit));
  }
  const NeighborGrid grid(positions, gap_m);
  Forest forest(points.size());
  for (size_t i = 0; i < points.size(); ++i) {
    grid.VisitWithin(positions[i], [&](size_t k, float) {
      if (k <= i || forest.RootOf(i) == forest.RootOf(k)) return;
      if (TellTheSame(around[i], around[k])) forest.Join(i, k);
    });
  }
  std::map<size_t, std::vector<PointChange>> by_root;
  for (size_t i = 0; i < points.size(); ++i) by_root[forest.RootOf(i)].push_back(points[i]);
  std::vector<std::vector<PointChange>> linked;
  for (auto& [root, members] : by_root) {
    if (members.size() >= min_points) linked.push_back(std::move(members));
  }
  return linked;
}

}  // namespace

bool TellTheSame(std::span<const PointCourse::Visit> a, std::span<const PointCourse::Visit> b) {
  size_t num_against = 0, num_there = 0, num_gone = 0;
  auto left = a.begin(), right = b.begin();
  while (left != a.end() && right != b.end()) {
    if (left->session != right->session) {
      ++(left->session < right->session ? left : right);
      continue;
    }
    num_against += left->is_there != right->is_there ? 1 : 0;
    num_there += left->is_there && right->is_there ? 1 : 0;
    num_gone += !left->is_there && !right->is_there ? 1 : 0;
    ++left, ++right;
  }
  const auto are_enough = [&](size_t num_alike) {
    return static_cast<double>(num_alike) >= kMinAgreement * static_cast<double>(num_alike + num_against);
  };
  return num_gone > 0 && are_enough(num_gone) && are_enough(num_there);
}

std::vector<std::vector<size_t>> SplitAtNecks(std::span<const Eigen::Vector3f> p_of_things_map,
                                              const Eigen::Vector3f& up_map) {
  std::vector<Eigen::Vector3f> p_map;
  for (const Eigen::Vector3f& p : p_of_things_map) p_map.push_back(p - up_map * up_map.dot(p));
  std::vector<size_t> everything(p_map.size());
  std::iota(everything.begin(), everything.end(), size_t{0});
  if (p_map.size() < kMinSplitPoints) return {everything};
  std::vector<size_t> num_near(p_map.size(), 0);
  const NeighborGrid near(p_map, kDensityRadiusM);
  for (size_t i = 0; i < p_map.size(); ++i) near.VisitWithin(p_map[i], [&](size_t, float) { ++num_near[i]; });
  std::vector<size_t> sorted = num_near;
  const auto middle = sorted.begin() + static_cast<std::ptrdiff_t>(sorted.size() / 2);
  std::nth_element(sorted.begin(), middle, sorted.end());
  const auto least = static_cast<size_t>(kCoreDensity * static_cast<double>(*middle));
  const auto is_core = [&](size_t i) { return num_near[i] >= least; };

  const NeighborGrid links(p_map, kCoreGapM);
  Forest forest(p_map.size());
  for (size_t i = 0; i < p_map.size(); ++i) {
    if (!is_core(i)) continue;
    links.VisitWithin(p_map[i], [&](size_t k, float) {
      if (k > i && is_core(k)) forest.Join(i, k);
    });
  }
  std::map<size_t, std::vector<size_t>> cores;
  for (size_t i = 0; i < p_map.size(); ++i) {
    if (is_core(i)) cores[forest.RootOf(i)].push_back(i);
  }
  std::erase_if(cores, [&](const auto& part) { return part.second.size() < kLeastPart; });
  if (cores.size() < 2) return {everything};
  std::vector<std::vector<size_t>> parts;
  std::vector<size_t> part_of(p_map.size(), p_map.size());
  for (const auto& [root, members] : cores) {
    for (const size_t i : members) part_of[i] = parts.size();
    parts.emplace_back();
  }
  // The rest goes to whom it is nearest to.
  for (size_t i = 0; i < p_map.size(); ++i) {
    size_t nearest = part_of[i];
    float least_m2 = std::numeric_limits<float>::infinity();
    for (size_t k = 0; k < p_map.size() && part_of[i] == p_map.size(); ++k) {
      if (part_of[k] == p_map.size() || !is_core(k)) continue;
      const float squared_m2 = (p_map[i] - p_map[k]).squaredNorm();
      if (squared_m2 < least_m2) least_m2 = squared_m2, nearest = part_of[k];
    }
    parts[nearest].push_back(i);
  }
  return parts;
}

std::vector<ChangedThing> GroupThings(std::span<const PointCourse> courses, std::span<const Eigen::Vector3f> p_map,
                                      const Eigen::Vector3f& up_map, const GroupingOptions& options) {
  struct Candidate {
    GroupEvent event;
    std::vector<PointChange> points;
  };
  const std::map<GroupEvent, std::vector<PointChange>> by_event = PointsOfEvents(courses);
  const std::vector<std::pair<GroupEvent, std::vector<PointChange>>> events(by_event.begin(), by_event.end());
  std::vector<std::vector<std::vector<PointChange>>> linked(events.size());
  ParallelFor(options.num_threads, static_cast<int>(events.size()), [&](int i) {
    const auto& [event, points] = events[static_cast<size_t>(i)];
    const float gap_m = options.sampled.contains(event.session) ? options.sampled_gap_m : options.gap_m;
    linked[static_cast<size_t>(i)] = Linked(courses, p_map, points, gap_m, options.min_points);
  });
  std::vector<Candidate> candidates;
  for (size_t i = 0; i < events.size(); ++i) {
    for (std::vector<PointChange>& points : linked[i]) candidates.push_back({events[i].first, std::move(points)});
  }
  // Where it cannot be told between which visits something happened, most of its points say when.
  std::ranges::stable_sort(candidates, std::greater(), [](const Candidate& one) { return one.points.size(); });
  std::vector<ChangedThing> things;
  std::vector<std::vector<bool>> taken(courses.size());  // by point and visit
  for (size_t i = 0; i < courses.size(); ++i) taken[i].resize(courses[i].visits.size());
  for (size_t group = 0; group < candidates.size(); ++group) {
    const auto& [event, points] = candidates[group];
    const auto is_taken = [&](const PointChange& one) { return static_cast<bool>(taken[one.point][one.visit]); };
    if (2 * static_cast<size_t>(std::ranges::count_if(points, is_taken)) > points.size()) continue;
    std::vector<Eigen::Vector3f> positions;
    for (const PointChange& one : points) {
      taken[one.point][one.visit] = true;
      positions.push_back(p_map[one.point]);
    }
    for (const std::vector<size_t>& part : SplitAtNecks(positions, up_map)) {
      if (part.size() < options.min_points) continue;
      ChangedThing& one = things.emplace_back(ChangedThing{event, {}, group});
      for (const size_t k : part) one.points.push_back(points[k]);
    }
  }
  return things;
}

}  // namespace mapp
