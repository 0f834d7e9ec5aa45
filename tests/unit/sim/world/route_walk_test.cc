#include "sim/world/route_walk.h"

#include "tests/unit/sim/world/street_grid.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <algorithm>
#include <set>

namespace mapp::sim {
namespace {

using test::StreetGrid;
using Walks = std::vector<std::vector<size_t>>;

constexpr double kLength_m = 120;

Walks Plan(const RouteGraph& graph, int num_users, uint64_t seed) {
  auto walks = PlanWalks(graph, num_users, kLength_m, seed);
  EXPECT_TRUE(walks.ok()) << walks.status();
  return std::move(walks).value();
}

double LengthOf(const RouteGraph& graph, const std::vector<size_t>& walk) {
  double length_m = 0;
  for (size_t i = 1; i < walk.size(); ++i) {
    length_m += (graph.nodes_world[walk[i]] - graph.nodes_world[walk[i - 1]]).norm();
  }
  return length_m;
}

using Edge = std::pair<size_t, size_t>;
std::set<Edge> DirectedEdges(const std::vector<size_t>& walk) {
  std::set<Edge> edges;
  for (size_t i = 1; i < walk.size(); ++i) edges.emplace(walk[i - 1], walk[i]);
  return edges;
}

TEST(RouteWalkTest, WalksFollowEdgesAndTurnBackOnlyInDeadEnds) {
  const RouteGraph graph = StreetGrid();
  std::set<Edge> streets;
  std::vector<int> degree(graph.nodes_world.size());
  for (const auto& [a, b] : graph.edges) {
    streets.emplace(a, b);
    streets.emplace(b, a);
    ++degree[a];
    ++degree[b];
  }
  for (const auto& walk : Plan(graph, 50, 3)) {
    EXPECT_GE(LengthOf(graph, walk), LengthWithMargin(kLength_m));
    for (size_t i = 1; i < walk.size(); ++i) ASSERT_TRUE(streets.contains({walk[i - 1], walk[i]}));
    for (size_t i = 2; i < walk.size(); ++i) {
      if (walk[i] == walk[i - 2]) {
        EXPECT_EQ(degree[walk[i - 1]], 1);
      }
    }
  }
}

TEST(RouteWalkTest, EveryWalkGoesPartlyWhereAnEarlierOneWent) {
  const Walks walks = Plan(StreetGrid(12, 12), 40, 5);
  std::set<size_t> starts;
  int num_reversed = 0;
  std::set<Edge> walked = DirectedEdges(walks[0]);
  for (size_t k = 1; k < walks.size(); ++k) {
    starts.insert(walks[k].front());
    const std::set<Edge> edges = DirectedEdges(walks[k]);
    const auto shares = [&](const Edge& e) { return walked.contains(e); };
    const auto faces = [&](const Edge& e) { return walked.contains({e.second, e.first}); };
    const auto num_shared = std::ranges::count_if(edges, shares);
    const auto num_faced = std::ranges::count_if(edges, faces);
    EXPECT_GE(std::max(num_shared, num_faced), 2) << "walk " << k;
    num_reversed += num_faced > 0 ? 1 : 0;
    if (k == 1) {
      EXPECT_GE(num_shared, 2);
      EXPECT_LT(num_shared, std::ssize(edges)) << "a part of its own as well";
    }
    walked.insert(edges.begin(), edges.end());
  }
  EXPECT_GT(starts.size(), 15U);
  EXPECT_GT(num_reversed, 0);
}

TEST(RouteWalkTest, WalksShorterThanAStreetMeetAsWell) {
  const auto walks = PlanWalks(StreetGrid(12, 12), 20, 8, 3);
  ASSERT_TRUE(walks.ok()) << walks.status();
  const auto street = [](const std::vector<size_t>& walk) { return std::minmax(walk[0], walk[1]); };
  for (const auto& walk : *walks) EXPECT_EQ(Edge(street(walk)), Edge(street(walks->front())));
}

TEST(RouteWalkTest, SomeWalksCloseALoop) {
  const RouteGraph graph = StreetGrid(12, 12);
  int num_loops = 0;
  for (const auto& walk : Plan(graph, 40, 5)) {
    const std::set<size_t> places(walk.begin(), walk.end());
    num_loops += places.size() < walk.size() ? 1 : 0;
  }
  EXPECT_GT(num_loops, 10);
}

TEST(RouteWalkTest, DependsOnTheSeedButNotOnWhoComesLater) {
  const RouteGraph graph = StreetGrid();
  const Walks few = Plan(graph, 5, 9);
  Walks many = Plan(graph, 30, 9);
  many.resize(few.size());
  EXPECT_EQ(few, many);
  EXPECT_NE(few, Plan(graph, 5, 10));
}

TEST(RouteWalkTest, OneStreetIsWalkedToAndFro) {
  RouteGraph graph;
  graph.nodes_world = {{0, 0, 1}, {4, 0, 1}};
  graph.edges = {{0, 1}};
  for (const auto& walk : Plan(graph, 3, 1)) EXPECT_GE(LengthOf(graph, walk), LengthWithMargin(kLength_m));
}

TEST(RouteWalkTest, RefusesAGraphThatCannotBeWalked) {
  RouteGraph graph;
  EXPECT_EQ(PlanWalks(graph, 1, 10, 1).status().code(), absl::StatusCode::kFailedPrecondition);
  graph.nodes_world = {{0, 0, 1}, {0, 0, 1}};
  graph.edges = {{0, 1}};
  EXPECT_EQ(PlanWalks(graph, 1, 10, 1).status().code(), absl::StatusCode::kFailedPrecondition);
  graph.edges = {{0, 2}};
  EXPECT_EQ(PlanWalks(graph, 1, 10, 1).status().code(), absl::StatusCode::kFailedPrecondition);
}

}  // namespace
}  // namespace mapp::sim
