#include "cli/label_places.h"

#include <algorithm>
#include <array>
#include <limits>

namespace mapp {
namespace {

Eigen::AlignedBox2d BoundsOf(const std::vector<Eigen::Vector2d>& outline_px) {
  Eigen::AlignedBox2d bounds;
  for (const Eigen::Vector2d& corner : outline_px) bounds.extend(corner);
  return bounds;
}

}  // namespace

LabelPlaces::LabelPlaces(const TopView::Viewport& area)
    : area_(Eigen::Vector2d(area.left_px, area.top_px),
            Eigen::Vector2d(area.left_px + area.width_px, area.top_px + area.height_px)) {}

void LabelPlaces::KeepClear(const std::vector<Eigen::Vector2d>& outline_px) { taken_.push_back(BoundsOf(outline_px)); }

double LabelPlaces::CoveredPx(const Rectangle& label) const {
  double covered = 0;
  for (const Rectangle& taken : taken_) {
    const Rectangle common = label.intersection(taken);
    if (!common.isEmpty()) covered += common.volume();
  }
  return covered;
}

Eigen::Vector2d LabelPlaces::Take(const std::vector<Eigen::Vector2d>& outline_px, const Eigen::Vector2d& size_px) {
  constexpr double kGapPx = 5;
  const Rectangle bounds = BoundsOf(outline_px);
  const auto along = [](int axis) {
    return [axis](const Eigen::Vector2d& a, const Eigen::Vector2d& b) { return a[axis] < b[axis]; };
  };
  const auto [leftmost, rightmost] = std::minmax_element(outline_px.begin(), outline_px.end(), along(0));
  const auto [highest, lowest] = std::minmax_element(outline_px.begin(), outline_px.end(), along(1));
  const Eigen::Vector2d half = size_px / 2;
  const Eigen::Vector2d before = bounds.min() - size_px - Eigen::Vector2d::Constant(kGapPx);
  const Eigen::Vector2d after = bounds.max() + Eigen::Vector2d::Constant(kGapPx);
  // Top left corners of the label, the best first: beside the outermost corners, then off the outline's bounds.
  const std::array<Eigen::Vector2d, 8> corners = {{{after.x(), rightmost->y() - half.y()},
                                                   {before.x(), leftmost->y() - half.y()},
                                                   {highest->x() - half.x(), before.y()},
                                                   {lowest->x() - half.x(), after.y()},
                                                   {after.x(), before.y()},
                                                   {before.x(), before.y()},
                                                   {after.x(), after.y()},
                                                   {before.x(), after.y()}}};
  Rectangle best;
  double least_covered = std::numeric_limits<double>::infinity();
  for (const Eigen::Vector2d& corner : corners) {
    const Eigen::Vector2d inside = corner.cwiseMax(area_.min()).cwiseMin((area_.max() - size_px).eval());
    const Rectangle label(inside, inside + size_px);
    const double covered = CoveredPx(label);
    if (covered >= least_covered) continue;
    least_covered = covered;
    best = label;
  }
  taken_.push_back(best);
  return {best.min().x(), best.max().y()};
}

}  // namespace mapp
