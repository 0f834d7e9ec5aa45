#include "mapp/geometry/neighbor_grid.h"

#include "mapp/base/rng.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <limits>
#include <set>
#include <vector>

namespace mapp {
namespace {

constexpr float kEdge = 0.3F;

std::vector<Eigen::Vector3f> ScatteredPoints() {
  Rng rng(1);
  std::vector<Eigen::Vector3f> points;
  for (int i = 0; i < 500; ++i) {
    points.emplace_back(rng.Uniform(-1, 1), rng.Uniform(-1, 1), rng.Uniform(-1, 1));
  }
  return points;
}

std::set<size_t> IndicesWithin(const std::vector<Eigen::Vector3f>& points, const Eigen::Vector3f& p, float distance) {
  std::set<size_t> found;
  for (size_t i = 0; i < points.size(); ++i) {
    if ((points[i] - p).squaredNorm() <= distance * distance) found.insert(i);
  }
  return found;
}

TEST(NeighborGridTest, VisitsEachPointWithinAnEdgeOnce) {
  const std::vector<Eigen::Vector3f> points = ScatteredPoints();
  const NeighborGrid grid(points, kEdge);
  for (const Eigen::Vector3f& p : points) {
    std::multiset<size_t> visited;
    grid.VisitWithin(p, [&](size_t i, float squared) {
      EXPECT_FLOAT_EQ(squared, (points[i] - p).squaredNorm());
      visited.insert(i);
    });
    const std::set<size_t> expected = IndicesWithin(points, p, kEdge);
    EXPECT_TRUE(std::ranges::equal(visited, expected));
    EXPECT_GE(grid.NumAround(p), expected.size());
    EXPECT_LE(grid.NumAround(p), IndicesWithin(points, p, 2 * std::sqrt(3.0F) * kEdge).size());
  }
}

TEST(NeighborGridTest, GoesOutwardsUntilToldToStop) {
  const std::vector<Eigen::Vector3f> points = ScatteredPoints();
  const NeighborGrid grid(points, kEdge);
  for (const float enough : {0.0F, 0.2F, 0.5F, std::numeric_limits<float>::max()}) {
    constexpr float kMaxDistance = 0.95F;
    const Eigen::Vector3f p(0.1F, -0.2F, 0.3F);
    std::multiset<size_t> visited;
    float done = -1;
    const auto is_done = [&](float distance) {
      // All that is nearer has been visited.
      const std::set<size_t> nearer = IndicesWithin(points, p, std::min(distance, kMaxDistance));
      EXPECT_TRUE(std::ranges::includes(visited, nearer)) << distance;
      done = distance;
      return distance >= enough;
    };
    grid.VisitOutwards(
        p, kMaxDistance, [&](size_t i, float) { visited.insert(i); }, is_done);
    EXPECT_GE(done, std::min(enough, kMaxDistance));
    EXPECT_LT(done, enough + kEdge);
    const std::set<size_t> once(visited.begin(), visited.end());
    EXPECT_EQ(once.size(), visited.size());
    EXPECT_TRUE(std::ranges::includes(IndicesWithin(points, p, kMaxDistance), once));
    if (enough > kMaxDistance) {
      EXPECT_EQ(once, IndicesWithin(points, p, kMaxDistance));
    }
  }
}

TEST(NeighborGridTest, MayBeEmpty) {
  const NeighborGrid grid({}, kEdge);
  const auto fail = [](size_t, float) { ADD_FAILURE(); };
  grid.VisitWithin({0, 0, 0}, fail);
  grid.VisitOutwards({0, 0, 0}, 1, fail, [](float) { return false; });
}

}  // namespace
}  // namespace mapp
