#include "cli/top_view.h"

#include <Eigen/Eigenvalues>

#include <algorithm>
#include <cmath>
#include <limits>
#include <numbers>

namespace mapp {
namespace {

/// Of the view's size, left free on each side.
constexpr double kMarginRatio = 0.04;
constexpr double kOutlierRatio = 0.01;
/// A map of one frame still gets a view this wide, metres.
constexpr double kMinExtentM = 1.0;

struct Interval {
  double low = 0;
  double high = 0;
  double center() const { return (low + high) / 2; }
  double length() const { return std::max(high - low, kMinExtentM); }
};

/// The interval of all `always`, and of `mostly` without its outermost values.
Interval RobustInterval(const std::vector<double>& always, std::vector<double> mostly) {
  std::vector<double> bounds = always;
  if (!mostly.empty()) {
    std::sort(mostly.begin(), mostly.end());
    const auto skip = static_cast<size_t>(kOutlierRatio * static_cast<double>(mostly.size()));
    bounds.push_back(mostly[skip]);
    bounds.push_back(mostly[mostly.size() - 1 - skip]);
  }
  if (bounds.empty()) return {};
  const auto [low, high] = std::minmax_element(bounds.begin(), bounds.end());
  return {*low, *high};
}

std::vector<double> Along(const Eigen::Vector3d& axis, const std::vector<Eigen::Vector3d>& points) {
  std::vector<double> values;
  values.reserve(points.size());
  for (const Eigen::Vector3d& point : points) values.push_back(axis.dot(point));
  return values;
}

/// The direction across `up` along which the smallest rectangle around the scene is longest: walls become upright.
Eigen::Vector3d LongestAxis(const Eigen::Vector3d& up, const std::vector<Eigen::Vector3d>& cameras,
                            const std::vector<Eigen::Vector3d>& points) {
  constexpr int kNumAngles = 90;
  const Eigen::Vector3d first = up.unitOrthogonal();
  const Eigen::Vector3d second = up.cross(first);
  Eigen::Vector3d best = first;
  double best_area = std::numeric_limits<double>::infinity();
  for (int i = 0; i < kNumAngles; ++i) {
    const double angle = i * std::numbers::pi / 2 / kNumAngles;
    const Eigen::Vector3d axis = std::cos(angle) * first + std::sin(angle) * second;
    const Eigen::Vector3d across = up.cross(axis);
    const double length = RobustInterval(Along(axis, cameras), Along(axis, points)).length();
    const double width = RobustInterval(Along(across, cameras), Along(across, points)).length();
    if (length * width >= best_area) continue;
    best_area = length * width;
    best = length >= width ? axis : across;
  }
  return best;
}

/// At most about `max_num` of the points, evenly picked.
std::vector<Eigen::Vector3d> Thinned(const std::vector<Eigen::Vector3d>& points, size_t max_num) {
  std::vector<Eigen::Vector3d> thinned;
  const size_t step = points.size() / max_num + 1;
  for (size_t i = 0; i < points.size(); i += step) thinned.push_back(points[i]);
  return thinned;
}

}  // namespace

Eigen::Vector3d EstimateUp(const std::vector<Pose3>& T_map_cameras) {
  if (T_map_cameras.empty()) return -Eigen::Vector3d::UnitY();
  // Small beside x axes that span the ground, so that pitch does not matter; large beside a hand's roll of a few
  // degrees.
  constexpr double kDownWeight = 0.02;
  Eigen::Matrix3d cost = Eigen::Matrix3d::Zero();
  Eigen::Vector3d mean_down = Eigen::Vector3d::Zero();
  for (const Pose3& T_map_camera : T_map_cameras) {
    const Eigen::Matrix3d axes_map = T_map_camera.RotationMatrix();
    cost += axes_map.col(0) * axes_map.col(0).transpose() - kDownWeight * axes_map.col(1) * axes_map.col(1).transpose();
    mean_down += axes_map.col(1);
  }
  const Eigen::Vector3d up = Eigen::SelfAdjointEigenSolver<Eigen::Matrix3d>(cost).eigenvectors().col(0);
  return up.dot(mean_down) > 0 ? Eigen::Vector3d(-up) : up;
}

TopView::TopView(const std::vector<Pose3>& T_map_cameras, const std::vector<Eigen::Vector3d>& points_map,
                 const Viewport& viewport)
    : up_(EstimateUp(T_map_cameras)) {
  std::vector<Eigen::Vector3d> cameras_map;
  for (const Pose3& T_map_camera : T_map_cameras) cameras_map.push_back(T_map_camera.translation());
  constexpr size_t kEnoughForOrientation = 10'000;
  const Eigen::Vector3d longest = LongestAxis(up_, cameras_map, Thinned(points_map, kEnoughForOrientation));
  right_ = viewport.width_px >= viewport.height_px ? longest : Eigen::Vector3d(longest.cross(up_));
  // Right, down and the viewing direction (-up) are right-handed, so that the view is not mirrored.
  down_ = right_.cross(up_);
  Fit(cameras_map, points_map, viewport);
}

TopView TopView::FittedTo(const std::vector<Eigen::Vector3d>& always_map,
                          const std::vector<Eigen::Vector3d>& mostly_map, const Viewport& viewport) const {
  TopView view = *this;
  view.Fit(always_map, mostly_map, viewport);
  return view;
}

void TopView::Fit(const std::vector<Eigen::Vector3d>& always_map, const std::vector<Eigen::Vector3d>& mostly_map,
                  const Viewport& viewport) {
  const Interval across = RobustInterval(Along(right_, always_map), Along(right_, mostly_map));
  const Interval along = RobustInterval(Along(down_, always_map), Along(down_, mostly_map));
  center_m_ = {across.center(), along.center()};
  center_px_ = {viewport.left_px + viewport.width_px / 2.0, viewport.top_px + viewport.height_px / 2.0};
  pixels_per_m_ =
      (1 - 2 * kMarginRatio) * std::min(viewport.width_px / across.length(), viewport.height_px / along.length());
}

Eigen::Vector2d TopView::ToPixel(const Eigen::Vector3d& p_map) const {
  return center_px_ + pixels_per_m_ * (Eigen::Vector2d(right_.dot(p_map), down_.dot(p_map)) - center_m_);
}

}  // namespace mapp
