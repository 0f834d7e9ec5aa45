#include "server/service/point_tree.h"

#include "mapp/base/rng.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <set>

namespace mapp::testing {
namespace {

std::vector<Eigen::Vector3f> RandomPoints(size_t count, Rng& rng) {
  std::vector<Eigen::Vector3f> points;
  for (size_t i = 0; i < count; ++i) {
    points.emplace_back(Eigen::Vector3d(rng.Uniform(-4, 4), rng.Uniform(-1, 1), rng.Uniform(-4, 4)).cast<float>());
  }
  return points;
}

TEST(PointTreeTest, RefusesNoPoints) {
  EXPECT_EQ(PointTree::Build({}).status().code(), absl::StatusCode::kInvalidArgument);
}

TEST(PointTreeTest, VisitsExactlyThePointsWithinTheRadius) {
  Rng rng(1);
  for (const size_t count : {1UL, 9UL, 500UL}) {
    const std::vector<Eigen::Vector3f> points = RandomPoints(count, rng);
    const StatusOr<PointTree> tree = PointTree::Build(points);
    ASSERT_TRUE(tree.ok());
    for (const Eigen::Vector3f& query : RandomPoints(50, rng)) {
      const auto radius = static_cast<float>(rng.Uniform(0.1, 2));
      std::set<size_t> visited;
      EXPECT_FALSE(tree->AnyWithin(query, radius, [&](size_t i) {
        visited.insert(i);
        return false;
      }));
      std::set<size_t> expected;
      for (size_t i = 0; i < count; ++i) {
        if ((points[i] - query).squaredNorm() < radius * radius) expected.insert(i);
      }
      EXPECT_EQ(visited, expected);
    }
  }
}

TEST(PointTreeTest, StopsAtTheFirstAcceptedPoint) {
  Rng rng(2);
  const StatusOr<PointTree> tree = PointTree::Build(RandomPoints(1000, rng));
  ASSERT_TRUE(tree.ok());
  int num_asked = 0;
  EXPECT_TRUE(tree->AnyWithin(Eigen::Vector3f::Zero(), 5, [&](size_t) {
    ++num_asked;
    return true;
  }));
  EXPECT_EQ(num_asked, 1);
}

TEST(PointTreeTest, FindsTheNearestInOrder) {
  Rng rng(3);
  const std::vector<Eigen::Vector3f> points = RandomPoints(200, rng);
  const StatusOr<PointTree> tree = PointTree::Build(points);
  ASSERT_TRUE(tree.ok());
  const Eigen::Vector3f query(0.3F, 0.1F, -0.7F);
  std::vector<size_t> expected(points.size());
  for (size_t i = 0; i < points.size(); ++i) expected[i] = i;
  std::sort(expected.begin(), expected.end(),
            [&](size_t a, size_t b) { return (points[a] - query).squaredNorm() < (points[b] - query).squaredNorm(); });
  expected.resize(8);
  EXPECT_EQ(tree->Nearest(query, 8), expected);
  EXPECT_EQ(tree->Nearest(query, 1000).size(), points.size());
}

}  // namespace
}  // namespace mapp::testing
