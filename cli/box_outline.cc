#include "cli/box_outline.h"

#include <algorithm>
#include <tuple>

namespace mapp {
namespace {

/// Twice the area of the triangle, positive when it is counterclockwise.
double TurnOf(const Eigen::Vector2d& a, const Eigen::Vector2d& b, const Eigen::Vector2d& c) {
  const Eigen::Vector2d ab = b - a;
  const Eigen::Vector2d ac = c - a;
  return ab.x() * ac.y() - ab.y() * ac.x();
}

}  // namespace

std::array<Eigen::Vector3d, 8> CornersOf(const OrientedBox& box) {
  std::array<Eigen::Vector3d, 8> corners;
  for (size_t i = 0; i < corners.size(); ++i) {
    const Eigen::Vector3d side((i & 1) != 0 ? 0.5 : -0.5, (i & 2) != 0 ? 0.5 : -0.5, (i & 4) != 0 ? 0.5 : -0.5);
    corners[i] = box.T_frame_box * side.cwiseProduct(box.size_m);
  }
  return corners;
}

std::vector<Eigen::Vector2d> ConvexHull(std::vector<Eigen::Vector2d> points) {
  // Upright boxes have corners over each other, up to rounding.
  constexpr double kSamePlace = 1e-9;
  std::ranges::sort(points, [](const Eigen::Vector2d& a, const Eigen::Vector2d& b) {
    return std::tuple(a.x(), a.y()) < std::tuple(b.x(), b.y());
  });
  // Andrew's monotone chain: the lower side forth, the upper side back.
  std::vector<Eigen::Vector2d> hull;
  const auto add_side = [&hull](const auto& begin, const auto& end) {
    const size_t start = hull.size();
    for (auto point = begin; point != end; ++point) {
      while (hull.size() >= start + 2 && TurnOf(hull[hull.size() - 2], hull.back(), *point) <= kSamePlace) {
        hull.pop_back();
      }
      if (hull.size() == start || (*point - hull.back()).norm() > kSamePlace) hull.push_back(*point);
    }
    hull.pop_back();  // the other side begins with it
  };
  if (points.size() < 2) return points;
  add_side(points.begin(), points.end());
  add_side(points.rbegin(), points.rend());
  if (hull.empty()) return {points.front()};  // all in one place
  return hull;
}

}  // namespace mapp
