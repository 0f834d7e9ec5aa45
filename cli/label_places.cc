#include "cli/label_places.h"

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
  const Eigen::Vector2d center = bounds.center() - size_px / 2;
  const Eigen::Vector2d before = bounds.min() - size_px - Eigen::Vector2d::Constant(kGapPx);
  const Eigen::Vector2d after = bounds.max() + Eigen::Vector2d::Constant(kGapPx);
  // Top left corners, the best first.
  const std::array<Eigen::Vector2d, 8> corners = {{{after.x(), bounds.min().y()},
                                                   {before.x(), bounds.min().y()},
                                                   {center.x(), before.y()},
                                                   {center.x(), after.y()},
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
