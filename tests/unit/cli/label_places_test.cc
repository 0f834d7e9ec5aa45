#include "cli/label_places.h"

#include <gtest/gtest.h>

namespace mapp {
namespace {

using Outline = std::vector<Eigen::Vector2d>;

constexpr TopView::Viewport kArea{10, 20, 400, 300};
const Eigen::Vector2d kSizePx(30, 12);

Outline SquareAt(double x, double y, double size) {
  return {{x, y}, {x + size, y}, {x + size, y + size}, {x, y + size}};
}

/// What a label covers whose text begins there on its baseline.
Eigen::AlignedBox2d LabelAt(const Eigen::Vector2d& left_baseline) {
  return {Eigen::Vector2d(left_baseline.x(), left_baseline.y() - kSizePx.y()),
          Eigen::Vector2d(left_baseline.x() + kSizePx.x(), left_baseline.y())};
}

TEST(LabelPlacesTest, IsBesideTheOutline) {
  LabelPlaces places(kArea);
  const Eigen::AlignedBox2d label = LabelAt(places.Take(SquareAt(100, 100, 40), kSizePx));
  EXPECT_GT(label.min().x(), 140);
  EXPECT_LT(label.min().x(), 150);
  EXPECT_GE(label.max().y(), 100);
  EXPECT_LE(label.min().y(), 140);
}

TEST(LabelPlacesTest, CoversNeitherLabelsNorOutlines) {
  LabelPlaces places(kArea);
  std::vector<Outline> outlines;
  for (int i = 0; i < 5; ++i) outlines.push_back(SquareAt(100 + 45 * i, 100, 40));
  std::vector<Eigen::AlignedBox2d> taken;
  for (const Outline& outline : outlines) {
    places.KeepClear(outline);
    taken.emplace_back(outline[0], outline[2]);
  }
  for (const Outline& outline : outlines) {
    const Eigen::AlignedBox2d label = LabelAt(places.Take(outline, kSizePx));
    for (const Eigen::AlignedBox2d& other : taken) EXPECT_TRUE(label.intersection(other).isEmpty());
    taken.push_back(label);
  }
}

TEST(LabelPlacesTest, StaysInThePicture) {
  for (const Eigen::Vector2d& corner :
       {Eigen::Vector2d(375, 25), Eigen::Vector2d(12, 300), Eigen::Vector2d(390, 310)}) {
    LabelPlaces places(kArea);
    const Outline outline = SquareAt(corner.x(), corner.y(), 30);
    places.KeepClear(outline);
    const Eigen::AlignedBox2d label = LabelAt(places.Take(outline, kSizePx));
    EXPECT_GE(label.min().x(), kArea.left_px);
    EXPECT_GE(label.min().y(), kArea.top_px);
    EXPECT_LE(label.max().x(), kArea.left_px + kArea.width_px);
    EXPECT_LE(label.max().y(), kArea.top_px + kArea.height_px);
  }
}

TEST(LabelPlacesTest, CrowdsStillGetPlaces) {
  LabelPlaces places(kArea);
  for (int i = 0; i < 100; ++i) EXPECT_TRUE(places.Take(SquareAt(100, 100, 40), kSizePx).allFinite());
}

}  // namespace
}  // namespace mapp
