#include "server/changes/point_history.h"

#include "server/changes/neighbor_grid.h"

#include <algorithm>
#include <map>
#include <numeric>
#include <unordered_map>
#include <unordered_set>
#include <utility>

namespace mapp {
namespace {

/// Sessions that may see one and miss the other of two points of one thing, as a share of those that judged both.
constexpr double kMaxContradiction = 0.2;

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

std::vector<ChangedThing> GroupThings(std::span<const PointHistory> histories, std::span<const Eigen::Vector3f> p_map,
                                      const GroupingOptions& options) {
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
  for (auto& [root, thing] : by_root) {
    if (thing.points.size() >= options.min_points) things.push_back(std::move(thing));
  }
  return things;
}

}  // namespace mapp
