#include "cli/top_view.h"

#include <gtest/gtest.h>

#include <cmath>
#include <numbers>

namespace mapp {
namespace {

constexpr double kPi = std::numbers::pi;

/// Cameras on a circle in a level world whose up is `R_map_level * (-y)`, each turned by `yaw_range` in all and
/// pitched.
std::vector<Pose3> Cameras(const Eigen::Quaterniond& R_map_level, double yaw_range, double pitch) {
  std::vector<Pose3> cameras;
  for (int i = 0; i < 20; ++i) {
    const double yaw = yaw_range * i / 20;
    const Eigen::Quaterniond R_level_camera =
        Eigen::AngleAxisd(yaw, Eigen::Vector3d::UnitY()) * Eigen::AngleAxisd(-pitch, Eigen::Vector3d::UnitX());
    const Eigen::Vector3d p_level(std::cos(yaw), 0, std::sin(yaw));
    cameras.push_back(Pose3(R_map_level * R_level_camera, R_map_level * p_level));
  }
  return cameras;
}

double AngleBetween(const Eigen::Vector3d& a, const Eigen::Vector3d& b) {
  return std::acos(std::clamp(a.normalized().dot(b.normalized()), -1.0, 1.0));
}

TEST(EstimateUpTest, FindsUpWhateverThePitchOfCamerasThatTurn) {
  const Eigen::Quaterniond R_map_level(Eigen::AngleAxisd(1.1, Eigen::Vector3d(1, 2, -1).normalized()));
  for (const double pitch_deg : {-30, 0, 20, 45}) {
    const auto cameras = Cameras(R_map_level, kPi, pitch_deg * kPi / 180);
    EXPECT_LT(AngleBetween(EstimateUp(cameras), R_map_level * -Eigen::Vector3d::UnitY()), 2 * kPi / 180)
        << "pitch " << pitch_deg;
  }
}

TEST(EstimateUpTest, TakesTheCamerasOwnUpWhenTheyNeverTurn) {
  const auto cameras = Cameras(Eigen::Quaterniond::Identity(), 0, 0.2);
  EXPECT_LT(AngleBetween(EstimateUp(cameras), -Eigen::Vector3d::UnitY()), 0.2 + 1e-6);
}

TEST(TopViewTest, FitsTheSceneIntoTheViewportAndLeavesStrayPointsOut) {
  std::vector<Eigen::Vector3d> points;
  for (int i = 0; i <= 200; ++i) points.push_back({-10 + 0.1 * i, 0, i % 2 == 0 ? -3.0 : 3.0});
  points.push_back({5000, 0, 0});
  const TopView view(Cameras(Eigen::Quaterniond::Identity(), kPi, 0), points, {100, 50, 800, 400});
  for (const Eigen::Vector3d& p : points) {
    const Eigen::Vector2d pixel = view.ToPixel(p);
    if (p.x() > 100) continue;
    EXPECT_GE(pixel.x(), 100);
    EXPECT_LE(pixel.x(), 900);
    EXPECT_GE(pixel.y(), 50);
    EXPECT_LE(pixel.y(), 450);
  }
  EXPECT_GT(view.pixels_per_m(), 25) << "the stray point must not shrink the view";
}

TEST(TopViewTest, PutsWallsUpright) {
  // A rectangle of 8 x 3 m, turned by 30 degrees about the vertical; one wall holds most of the points.
  const Eigen::Quaterniond R_map_room(Eigen::AngleAxisd(kPi / 6, Eigen::Vector3d::UnitY()));
  std::vector<Eigen::Vector3d> points;
  for (int i = 0; i <= 400; ++i) {
    points.push_back(R_map_room * Eigen::Vector3d(0.02 * i, -1, 0));
    if (i % 10 == 0) points.push_back(R_map_room * Eigen::Vector3d(0.02 * i, -1, 3));
    if (i % 10 == 0) points.push_back(R_map_room * Eigen::Vector3d(8, -1, 3 * i / 400.0));
  }
  const TopView view(Cameras(Eigen::Quaterniond::Identity(), kPi, 0), points, {0, 0, 800, 400});
  const Eigen::Vector2d wall = view.ToPixel(R_map_room * Eigen::Vector3d(8, 0, 0)) - view.ToPixel({0, 0, 0});
  EXPECT_LT(std::abs(wall.y()), 0.05 * std::abs(wall.x()));
}

TEST(TopViewTest, IsNotMirrored) {
  const TopView view(Cameras(Eigen::Quaterniond::Identity(), kPi, 0), {{0, 0, 0}, {4, 0, 0}, {0, 0, 1}},
                     {0, 0, 400, 200});
  const Eigen::Vector2d origin = view.ToPixel({0, 0, 0});
  const Eigen::Vector2d right = view.ToPixel({1, 0, 0}) - origin;
  const Eigen::Vector2d ahead = view.ToPixel({0, 0, 1}) - origin;
  // From above, with up = -y, what lies to the right (x) of someone looking along z is clockwise of z: in an image
  // with y down, cross(ahead, right) > 0.
  EXPECT_GT(ahead.x() * right.y() - ahead.y() * right.x(), 0);
  EXPECT_NEAR(right.norm(), view.pixels_per_m(), 1e-9);
}

TEST(TopViewTest, FitsAnotherStretchLookingTheSameWay) {
  const TopView view(Cameras(Eigen::Quaterniond::Identity(), kPi, 0), {{-10, 0, -4}, {10, 0, 4}}, {0, 0, 800, 400});
  const TopView near = view.FittedTo({{3, 0, 1}, {5, 0, 2}}, {}, {500, 50, 200, 100});
  EXPECT_GT(near.pixels_per_m(), 1.5 * view.pixels_per_m());
  const TopView::Viewport viewport{500, 50, 200, 100};
  EXPECT_TRUE(viewport.Contains(near.ToPixel({3, 0, 1})));
  EXPECT_TRUE(viewport.Contains(near.ToPixel({5, 0, 2})));
  EXPECT_FALSE(viewport.Contains(near.ToPixel({-3, 0, 1})));
  const Eigen::Vector2d here = view.ToPixel({1, 0, 1}) - view.ToPixel({0, 0, 0});
  const Eigen::Vector2d there = near.ToPixel({1, 0, 1}) - near.ToPixel({0, 0, 0});
  EXPECT_LT((here / view.pixels_per_m() - there / near.pixels_per_m()).norm(), 1e-9);
}

TEST(TopViewTest, HeightGrowsUpwards) {
  const TopView view(Cameras(Eigen::Quaterniond::Identity(), kPi, 0), {}, {0, 0, 100, 100});
  EXPECT_GT(view.Height({0, -1, 0}), view.Height({0, 1, 0}));
}

TEST(TopViewTest, ShowsASingleCameraWithoutDividingByZero) {
  const TopView view({Pose3()}, {}, {0, 0, 100, 100});
  EXPECT_TRUE(view.ToPixel({0, 0, 0}).allFinite());
  EXPECT_GT(view.pixels_per_m(), 0);
}

}  // namespace
}  // namespace mapp
