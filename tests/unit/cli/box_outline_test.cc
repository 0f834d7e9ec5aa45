#include "cli/box_outline.h"

#include "mapp/base/rng.h"

#include <gmock/gmock.h>

#include <cmath>

namespace mapp {
namespace {

using Corners = std::vector<Eigen::Vector2d>;

double AreaOf(const Corners& ring) {
  double twice_area = 0;
  for (size_t i = 0; i < ring.size(); ++i) {
    const Eigen::Vector2d& a = ring[i];
    const Eigen::Vector2d& b = ring[(i + 1) % ring.size()];
    twice_area += a.x() * b.y() - a.y() * b.x();
  }
  return twice_area / 2;
}

TEST(BoxOutlineTest, CornersAreHalfTheSizeFromTheCentre) {
  const OrientedBox box{
      .T_frame_box = Pose3(Eigen::Quaterniond(Eigen::AngleAxisd(1, Eigen::Vector3d::UnitZ())), {5, 6, 7}),
      .size_m = {2, 4, 6}};
  Eigen::Vector3d sum = Eigen::Vector3d::Zero();
  for (const Eigen::Vector3d& corner : CornersOf(box)) {
    sum += corner;
    EXPECT_NEAR((corner - box.T_frame_box.translation()).norm(), Eigen::Vector3d(1, 2, 3).norm(), 1e-12);
    EXPECT_TRUE(box.Contains(corner, 1e-9));
  }
  EXPECT_LT((sum / 8 - box.T_frame_box.translation()).norm(), 1e-12);
}

TEST(ConvexHullTest, AnUprightTurnedBoxHasFourCorners) {
  for (int yaw_deg = 0; yaw_deg < 180; yaw_deg += 7) {
    const OrientedBox box{
        .T_frame_box =
            Pose3(Eigen::Quaterniond(Eigen::AngleAxisd(yaw_deg * M_PI / 180, Eigen::Vector3d::UnitZ())), {50, -60, 7}),
        .size_m = {2, 4, 6}};
    Corners corners;
    for (const Eigen::Vector3d& corner : CornersOf(box)) corners.emplace_back(corner.head<2>());
    const Corners hull = ConvexHull(corners);
    EXPECT_EQ(hull.size(), 4U) << yaw_deg;
    EXPECT_NEAR(AreaOf(hull), 8, 1e-9) << "counterclockwise";
  }
}

TEST(ConvexHullTest, ATiltedBoxHasSix) {
  const OrientedBox box{.T_frame_box = Pose3(Eigen::Quaterniond(1, 0.3, 0.2, 0.1), {0, 0, 0}), .size_m = {1, 2, 3}};
  Corners corners;
  for (const Eigen::Vector3d& corner : CornersOf(box)) corners.emplace_back(corner.head<2>());
  EXPECT_EQ(ConvexHull(corners).size(), 6U);
}

TEST(ConvexHullTest, HoldsAllPoints) {
  Rng rng(3);
  Corners points;
  for (int i = 0; i < 200; ++i) points.emplace_back(rng.Uniform(-5, 5), rng.Uniform(-2, 2));
  const Corners hull = ConvexHull(points);
  for (const Eigen::Vector2d& point : points) {
    for (size_t i = 0; i < hull.size(); ++i) {
      EXPECT_GE(AreaOf({hull[i], hull[(i + 1) % hull.size()], point}), -1e-9);
    }
  }
}

TEST(ConvexHullTest, TakesWhatHasNoArea) {
  EXPECT_EQ(ConvexHull({}).size(), 0U);
  EXPECT_EQ(ConvexHull({{1, 2}}).size(), 1U);
  EXPECT_EQ(ConvexHull({{1, 2}, {1, 2}, {1, 2}}).size(), 1U);
  EXPECT_EQ(ConvexHull({{0, 0}, {1, 1}, {2, 2}, {1, 1}}).size(), 2U);
}

}  // namespace
}  // namespace mapp
