#include "vision/corner_spreading.h"

#include "mapp/base/rng.h"

#include <gtest/gtest.h>

#include <algorithm>

namespace mapp::internal {
namespace {

cv::KeyPoint Corner(float x, float y, float response) { return cv::KeyPoint(x, y, 7.0F, -1.0F, response); }

/// 400 strong corners in the top-left 64 x 64 pixels, 400 weak ones all over.
std::vector<cv::KeyPoint> CrowdedCorners() {
  Rng rng(3);
  std::vector<cv::KeyPoint> corners;
  const auto add = [&](double edge_px, double strength) {
    const auto x = static_cast<float>(std::floor(rng.Uniform(0, edge_px)));
    const auto y = static_cast<float>(std::floor(rng.Uniform(0, edge_px)));
    corners.push_back(Corner(x, y, static_cast<float>(strength + rng.Uniform())));
  };
  for (int i = 0; i < 400; ++i) add(64, 100);
  for (int i = 0; i < 400; ++i) add(512, 10);
  return corners;
}

TEST(SpreadCornersTest, KeepsAllWhenThereAreFew) {
  std::vector<cv::KeyPoint> corners = {Corner(1, 1, 5), Corner(2, 2, 9)};
  SpreadCorners(corners, 512, 512, 10);
  ASSERT_EQ(corners.size(), 2U);
  EXPECT_EQ(corners[0].response, 9);
}

TEST(SpreadCornersTest, FillsTheQuotaExactly) {
  for (const int quota : {0, 1, 17, 400, 800}) {
    std::vector<cv::KeyPoint> corners = CrowdedCorners();
    SpreadCorners(corners, 512, 512, quota);
    EXPECT_EQ(static_cast<int>(corners.size()), quota);
  }
}

TEST(SpreadCornersTest, LimitsACrowdedCell) {
  std::vector<cv::KeyPoint> corners = CrowdedCorners();
  SpreadCorners(corners, 512, 512, 200);
  const auto num_crowded = std::count_if(
      corners.begin(), corners.end(), [](const cv::KeyPoint& corner) { return corner.pt.x < 64 && corner.pt.y < 64; });
  // An even share of 64 cells is about three; two and a half of them may stay.
  EXPECT_EQ(num_crowded, 7);
}

TEST(SpreadCornersTest, KeepsTheStrongestOfEachCell) {
  std::vector<cv::KeyPoint> corners = CrowdedCorners();
  std::vector<cv::KeyPoint> expected = corners;
  SpreadCorners(corners, 512, 512, 200);
  const auto strongest = std::max_element(expected.begin(), expected.end(),
                                          [](const auto& a, const auto& b) { return a.response < b.response; });
  EXPECT_EQ(corners.front().response, strongest->response);
}

TEST(SpreadCornersTest, DoesNotDependOnTheInputOrder) {
  std::vector<cv::KeyPoint> forward = CrowdedCorners();
  std::vector<cv::KeyPoint> backward(forward.rbegin(), forward.rend());
  SpreadCorners(forward, 512, 512, 150);
  SpreadCorners(backward, 512, 512, 150);
  ASSERT_EQ(forward.size(), backward.size());
  for (size_t i = 0; i < forward.size(); ++i) {
    EXPECT_EQ(forward[i].pt, backward[i].pt);
    EXPECT_EQ(forward[i].response, backward[i].response);
  }
}

}  // namespace
}  // namespace mapp::internal
