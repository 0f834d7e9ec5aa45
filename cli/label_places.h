#pragma once

#include "cli/top_view.h"

#include <Eigen/Core>
#include <Eigen/Geometry>

#include <vector>

namespace mapp {

/// Finds room for labels beside outlines of a picture, so that they cover neither each other nor the outlines.
class LabelPlaces {
 public:
  /// Labels stay within `area`.
  explicit LabelPlaces(const TopView::Viewport& area);

  /// Labels avoid what is around this outline, as far as there is room.
  void KeepClear(const std::vector<Eigen::Vector2d>& outline_px);
  /// Where the text of a label of that size begins on its baseline, beside the outline, which has corners. The place is
  /// taken then. Of places that all cover something the one that covers least.
  Eigen::Vector2d Take(const std::vector<Eigen::Vector2d>& outline_px, const Eigen::Vector2d& size_px);

 private:
  using Rectangle = Eigen::AlignedBox2d;

  double CoveredPx(const Rectangle& label) const;

  Rectangle area_;
  std::vector<Rectangle> taken_;
};

}  // namespace mapp
