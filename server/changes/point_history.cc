#include "server/changes/point_history.h"

#include "server/changes/neighbor_grid.h"

#include <algorithm>
#include <limits>
#include <map>
#include <numeric>
#include <unordered_map>
#include <unordered_set>
#include <utility>

namespace mapp {
namespace {

/// Sessions that may see one and miss the other of two points of one thing, as a share of those that judged both.
constexpr double kMaxContradiction = 0.2;

// Of SplitAtNecks: points that have so many neighbours within kDensityRadiusM as this share of the median are core
// points; core points further apart than kCoreGapM belong to different parts, which hold a share of all points each.
constexpr size_t kMinSplitPoints = 150;
constexpr float kDensityRadiusM = 0.25F;
constexpr double kCoreDensity = 0.1;
constexpr float kCoreGapM = 0.25F;
constexpr size_t kLeastPart = 50;

template <typename Visit>
void ForEachFinding(const SessionFindings& findings, const Visit& visit) {
  for (const PointFinding& finding : findings.own) visit(findings.session, finding);
  for (const auto& [session, found] : findings.earlier) {
    for (const PointFinding& finding : found) visit(session, finding);
  }
}

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

}  // namespace

std::vector<PointHistory> HistoriesOfMissed(std::span<const SessionFindings> findings) {
  std::unordered_set<MapPointId> missed;
  for (const SessionFindings& of_session : findings) {
    ForEachFinding(of_session, [&](SessionId session, const PointFinding& finding) {
      if (PointHistory::Visit{session, finding.num_seen, finding.num_missed}.missed()) missed.insert(finding.point);
    });
  }
  std::map<MapPointId, PointHistory> histories;
  for (const SessionFindings& of_session : findings) {
    ForEachFinding(of_session, [&](SessionId session, const PointFinding& finding) {
      if (!missed.contains(finding.point)) return;
      PointHistory& history = histories[finding.point];
      history.point = finding.point;
      history.visits.push_back({session, finding.num_seen, finding.num_missed});
    });
  }
  std::vector<PointHistory> result;
  for (auto& [id, history] : histories) {
    std::sort(history.visits.begin(), history.visits.end(),
              [](const auto& a, const auto& b) { return a.session < b.session; });
    result.push_back(std::move(history));
  }
  return result;
}

bool TellTheSame(const PointHistory& a, const PointHistory& b) {
  size_t num_both = 0, num_against = 0, num_missed = 0;
  auto left = a.visits.begin(), right = b.visits.begin();
  while (left != a.visits.end() && right != b.visits.end()) {
    if (left->session != right->session) {
      ++(left->session < right->session ? left : right);
      continue;
    }
    if ((left->seen() || left->missed()) && (right->seen() || right->missed())) {
      ++num_both;
      num_against += left->missed() != right->missed() ? 1 : 0;
      num_missed += left->missed() && right->missed() ? 1 : 0;
    }
    ++left, ++right;
  }
  return num_missed > 0 && static_cast<double>(num_against) <= kMaxContradiction * static_cast<double>(num_both);
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

std::vector<ChangedThing> GroupThings(std::span<const PointHistory> histories, std::span<const Eigen::Vector3f> p_map,
                                      const Eigen::Vector3f& up_map, const GroupingOptions& options) {
  const NeighborGrid grid(p_map, options.gap_m);
  Forest forest(histories.size());
  for (size_t i = 0; i < histories.size(); ++i) {
    grid.VisitWithin(p_map[i], [&](size_t j, float) {
      if (j > i && forest.RootOf(i) != forest.RootOf(j) && TellTheSame(histories[i], histories[j])) forest.Join(i, j);
    });
  }
  std::map<size_t, ChangedThing> by_root;
  for (size_t i = 0; i < histories.size(); ++i) by_root[forest.RootOf(i)].points.push_back(i);
  std::vector<ChangedThing> things;
  for (const auto& [root, thing] : by_root) {
    std::vector<Eigen::Vector3f> positions;
    for (const size_t i : thing.points) positions.push_back(p_map[i]);
    for (const std::vector<size_t>& part : SplitAtNecks(positions, up_map)) {
      if (part.size() < options.min_points) continue;
      ChangedThing& one = things.emplace_back();
      one.group = root;
      for (const size_t k : part) one.points.push_back(thing.points[k]);
    }
  }
  return things;
}

}  // namespace mapp
