#include "sim/world/route_walk.h"

#include "mapp/base/rng.h"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <functional>
#include <limits>
#include <map>
#include <queue>
#include <utility>

namespace mapp::sim {
namespace {

using Walk = std::vector<size_t>;

constexpr double kFar_m = std::numeric_limits<double>::infinity();
/// Of the walk's length, before it joins another: the shared stretch must not lie behind its end.
constexpr double kLongestApproach = 0.45;
constexpr size_t kNoNode = std::numeric_limits<size_t>::max();

/// Shortest ways from everywhere to one node.
struct WaysTo {
  std::vector<double> distance_m;  ///< infinite where there is none
  std::vector<size_t> next;        ///< on the way there; kNoNode at its end
};

class Planner {
 public:
  Planner(const RouteGraph& graph, double length_m)
      : graph_(graph), length_m_(length_m), neighbors_(graph.nodes_world.size()) {
    for (const auto& [a, b] : graph.edges) {
      neighbors_[a].push_back(b);
      neighbors_[b].push_back(a);
    }
    for (size_t node = 0; node < neighbors_.size(); ++node) {
      std::ranges::sort(neighbors_[node]);
      if (!neighbors_[node].empty()) reachable_.push_back(node);
    }
  }

  /// A walk on its own.
  Walk Alone(Rng& rng) const {
    Walk walk = {reachable_[rng.Below(reachable_.size())]};
    Extend(rng, walk);
    return walk;
  }

  /// A walk that joins `other` for a while.
  Walk Joining(const Walk& other, bool may_reverse, Rng& rng) const {
    Walk shared = Stretch(other, rng.Uniform(0.25, 0.5) * length_m_, rng);
    const bool reverse = rng.Uniform() < 0.25;
    if (reverse && may_reverse) std::ranges::reverse(shared);
    Walk walk = Approach(shared, rng.Uniform(0.05, 0.35) * length_m_, rng);
    walk.insert(walk.end(), shared.begin(), shared.end());
    Extend(rng, walk);
    return walk;
  }

 private:
  double Step(size_t a, size_t b) const { return (graph_.nodes_world[a] - graph_.nodes_world[b]).norm(); }

  double LengthOf(const Walk& walk) const {
    double length_m = 0;
    for (size_t i = 1; i < walk.size(); ++i) length_m += Step(walk[i - 1], walk[i]);
    return length_m;
  }

  /// Dijkstra 1959. Ways that would arrive at `goal` from `forbidden` are left out.
  WaysTo ShortestWays(size_t goal, size_t forbidden) const {
    WaysTo ways{std::vector<double>(neighbors_.size(), kFar_m), std::vector<size_t>(neighbors_.size(), kNoNode)};
    using Entry = std::pair<double, size_t>;
    std::priority_queue<Entry, std::vector<Entry>, std::greater<>> open;
    ways.distance_m[goal] = 0;
    open.emplace(0.0, goal);
    while (!open.empty()) {
      const auto [distance_m, node] = open.top();
      open.pop();
      if (distance_m > ways.distance_m[node]) continue;
      for (const size_t neighbor : neighbors_[node]) {
        if (node == goal && neighbor == forbidden) continue;
        const double longer_m = distance_m + Step(node, neighbor);
        if (longer_m >= ways.distance_m[neighbor]) continue;
        ways.distance_m[neighbor] = longer_m;
        ways.next[neighbor] = node;
        open.emplace(longer_m, neighbor);
      }
    }
    return ways;
  }

  /// A piece of a walk of about that length, of at least one edge.
  Walk Stretch(Walk walk, double length_m, Rng& rng) const {
    while (walk.size() > 2 && LengthOf(walk) > length_m_) walk.pop_back();
    size_t last_begin = walk.size() - 2;
    double remaining_m = Step(walk[last_begin], walk.back());
    while (last_begin > 0 && remaining_m < length_m) {
      --last_begin;
      remaining_m += Step(walk[last_begin], walk[last_begin + 1]);
    }
    const size_t begin = rng.Below(last_begin + 1);
    Walk stretch = {walk[begin], walk[begin + 1]};
    while (LengthOf(stretch) < length_m && begin + stretch.size() < walk.size()) {
      stretch.push_back(walk[begin + stretch.size()]);
    }
    return stretch;
  }

  /// The way to the stretch's first node, without it, that does not turn back there; about `length_m` long where the
  /// graph has such.
  Walk Approach(const Walk& stretch, double length_m, Rng& rng) const {
    const WaysTo ways = ShortestWays(stretch[0], stretch[1]);
    std::vector<std::pair<double, size_t>> starts;
    for (const size_t node : reachable_) {
      const bool near = ways.distance_m[node] <= kLongestApproach * length_m_;
      if (near) starts.emplace_back(std::abs(ways.distance_m[node] - length_m), node);
    }
    std::ranges::sort(starts);
    constexpr size_t kNumChoices = 5;
    size_t node = starts[rng.Below(std::min(starts.size(), kNumChoices))].second;
    Walk approach;
    for (; node != stretch[0]; node = ways.next[node]) approach.push_back(node);
    return approach;
  }

  /// Goes on until the walk is long enough; half of the walks come back to where they began.
  void Extend(Rng& rng, Walk& walk) const {
    const bool closes_loop = rng.Uniform() < 0.5;
    const WaysTo home = ShortestWays(walk.front(), kNoNode);
    double walked_m = LengthOf(walk);
    std::map<std::pair<size_t, size_t>, int> num_walked;
    for (size_t i = 1; i < walk.size(); ++i) ++num_walked[std::minmax(walk[i - 1], walk[i])];
    while (walked_m < LengthWithMargin(length_m_)) {
      const bool homewards = closes_loop && walked_m < length_m_;
      const size_t next = Next(walk, num_walked, homewards ? length_m_ - walked_m : kFar_m, home, rng);
      walked_m += Step(walk.back(), next);
      ++num_walked[std::minmax(walk.back(), next)];
      walk.push_back(next);
    }
  }

  size_t Next(const Walk& walk, const std::map<std::pair<size_t, size_t>, int>& num_walked, double budget_m,
              const WaysTo& home, Rng& rng) const {
    const size_t here = walk.back();
    const size_t previous = walk.size() > 1 ? walk[walk.size() - 2] : kNoNode;
    std::vector<std::pair<size_t, double>> choices;  // node, weight
    double sum = 0;
    size_t homeward = previous;
    double homeward_m = kFar_m;
    for (const size_t node : neighbors_[here]) {
      if (node == previous) continue;
      const double via_m = Step(here, node) + home.distance_m[node];
      if (via_m < homeward_m) std::tie(homeward, homeward_m) = std::pair(node, via_m);
      if (budget_m < kFar_m && via_m > budget_m) continue;
      const auto walked = num_walked.find(std::minmax(here, node));
      choices.emplace_back(node, Weight(previous, here, node, walked == num_walked.end() ? 0 : walked->second));
      sum += choices.back().second;
    }
    if (choices.empty()) return homeward;  // or back, in a dead end
    double drawn = rng.Uniform() * sum;
    for (const auto& [node, weight] : choices) {
      drawn -= weight;
      if (drawn < 0) return node;
    }
    return choices.back().first;
  }

  /// Rather straight on than round the corner, rather where the walk has not been, hardly ever into a dead end.
  double Weight(size_t previous, size_t here, size_t next, int num_walked) const {
    const Eigen::Vector3d ahead = (graph_.nodes_world[next] - graph_.nodes_world[here]).normalized();
    double straightness = 0;
    if (previous != kNoNode) {
      straightness = std::max(ahead.dot((graph_.nodes_world[here] - graph_.nodes_world[previous]).normalized()), 0.0);
    }
    const double dead_end = neighbors_[next].size() == 1 ? 0.05 : 1.0;
    return dead_end * (1 + 2 * straightness) / ((1 + num_walked) * (1 + num_walked));
  }

  const RouteGraph& graph_;
  const double length_m_;
  std::vector<std::vector<size_t>> neighbors_;
  std::vector<size_t> reachable_;  ///< nodes that have an edge
};

Status CheckGraph(const RouteGraph& graph) {
  if (graph.edges.empty()) return absl::FailedPreconditionError("routes: the world has no ways");
  for (size_t i = 0; i < graph.edges.size(); ++i) {
    const auto [a, b] = graph.edges[i];
    const size_t n = graph.nodes_world.size();
    if (a >= n || b >= n || !((graph.nodes_world[a] - graph.nodes_world[b]).norm() > 0)) {
      return absl::FailedPreconditionError(
          fmt::format("routes: edge {} ({}, {}) does not join two of {} places", i, a, b, n));
    }
  }
  return absl::OkStatus();
}

}  // namespace

StatusOr<std::vector<std::vector<size_t>>> PlanWalks(const RouteGraph& graph, int num_users, double length_m,
                                                     uint64_t seed) {
  MAPP_RETURN_IF_ERROR(CheckGraph(graph));
  const Planner planner(graph, length_m);
  std::vector<Walk> walks;
  Rng seeds(seed);
  for (int user = 0; user < num_users; ++user) {
    Rng rng(seeds.Next());
    if (user == 0) {
      walks.push_back(planner.Alone(rng));
    } else {
      // The second user goes the first one's way: two are enough to see a shared map at work.
      walks.push_back(planner.Joining(walks[rng.Below(walks.size())], /*may_reverse=*/user > 1, rng));
    }
  }
  return walks;
}

}  // namespace mapp::sim
