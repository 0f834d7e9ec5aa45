#include "server/changes/thing_sighting.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <limits>
#include <map>
#include <utility>

namespace mapp {
namespace {

/// Least points of a thing in view for an outline.
constexpr size_t kMinPoints = 5;
/// Points of a thing that are asked how deep it is at a ray, evenly chosen from all: each ray looks through them.
constexpr size_t kMaxDepthPoints = 256;
/// Of them, those around a ray that tell.
constexpr size_t kNumAround = 3;
/// Own points this much deeper than the thing there passed it, as half a logarithm of depth (12 %); so much before it
/// they hide it.
constexpr float kDepthTolerance = 0.06F;
/// Where measuring ends it does so for some features before others.
constexpr float kSureShare = 0.9F;

/// What the rays of one square of the image (DepthRaster) say, the strongest last.
enum class RayEnd : uint8_t { kPassed, kBlocked, kHit };

float Cross(const Eigen::Vector2f& o, const Eigen::Vector2f& a, const Eigen::Vector2f& b) {
  return (a - o).x() * (b - o).y() - (a - o).y() * (b - o).x();
}

/// Convex hull, counterclockwise (Andrew's monotone chain).
std::vector<Eigen::Vector2f> HullOf(std::vector<Eigen::Vector2f> points) {
  std::sort(points.begin(), points.end(),
            [](const auto& a, const auto& b) { return a.x() != b.x() ? a.x() < b.x() : a.y() < b.y(); });
  std::vector<Eigen::Vector2f> hull;
  const auto add = [&](const Eigen::Vector2f& p, size_t least) {
    while (hull.size() >= least + 2 && Cross(hull[hull.size() - 2], hull.back(), p) <= 0) hull.pop_back();
    hull.push_back(p);
  };
  for (const Eigen::Vector2f& p : points) add(p, 0);
  const size_t lower = hull.size() - 1;
  for (auto p = points.rbegin(); p != points.rend(); ++p) add(*p, lower);
  hull.pop_back();
  return hull;
}

bool IsInside(const std::vector<Eigen::Vector2f>& hull, const Eigen::Vector2f& p) {
  for (size_t i = 0; i < hull.size(); ++i) {
    if (Cross(hull[i], hull[(i + 1) % hull.size()], p) < 0) return false;
  }
  return hull.size() >= 3;
}

/// Least and greatest of the depths of the thing's points next to a ray: it may be long, and seen along its side.
std::pair<float, float> DepthsAround(const Eigen::Vector2f& ray, std::span<const Eigen::Vector2f> outline,
                                     std::span<const float> half_ln_depths) {
  std::array<std::pair<float, float>, kNumAround> around;
  around.fill({std::numeric_limits<float>::infinity(), 0.0F});
  for (size_t i = 0; i < outline.size(); ++i) {
    const float squared = (outline[i] - ray).squaredNorm();
    if (squared >= around.back().first) continue;
    around.back() = {squared, half_ln_depths[i]};
    for (size_t k = around.size() - 1; k > 0 && around[k].first < around[k - 1].first; --k) {
      std::swap(around[k], around[k - 1]);
    }
  }
  const auto [least, greatest] = std::minmax_element(around.begin(), around.end(),
                                                     [](const auto& a, const auto& b) { return a.second < b.second; });
  return {least->second, greatest->second};
}

}  // namespace

ThingSighting SightThing(const WitnessView& view, std::span<const Eigen::Vector3f> p_map,
                         std::span<const Eigen::Vector3f> directions) {
  const Pose3 T_camera_map = view.T_map_camera.Inverse();
  const Eigen::Matrix3f R_camera_map = T_camera_map.RotationMatrix().cast<float>();
  const Eigen::Vector3f t_camera_map = T_camera_map.translation().cast<float>();
  const Eigen::Vector3f center_map = view.T_map_camera.translation().cast<float>();
  const PinholeCamera pinhole = view.camera.Undistorted();
  const float farthest_m = std::min(static_cast<float>(view.range_m), kSureShare * view.geometry.farthest_depth_m());
  std::vector<Eigen::Vector2f> outline;
  std::vector<float> half_ln_depths;
  for (size_t i = 0; i < p_map.size(); ++i) {
    const Eigen::Vector3f p_camera = R_camera_map * p_map[i] + t_camera_map;
    if (p_camera.z() <= 0 || p_camera.z() > farthest_m) continue;
    if (!view.camera.Contains(pinhole.Project(p_camera.cast<double>()))) continue;
    if ((p_map[i] - center_map).normalized().dot(directions[i]) < kLikeViewCosine) continue;
    outline.emplace_back(p_camera.x() / p_camera.z(), p_camera.y() / p_camera.z());
    half_ln_depths.push_back(0.5F * std::log(p_camera.z()));
  }
  ThingSighting sighting;
  if (outline.size() < kMinPoints) return sighting;
  const std::vector<Eigen::Vector2f> hull = HullOf(outline);
  for (size_t i = 2; i < hull.size(); ++i) sighting.outline_area += 0.5 * Cross(hull[0], hull[i - 1], hull[i]);
  const size_t step = (outline.size() + kMaxDepthPoints - 1) / kMaxDepthPoints;
  size_t num_depths = 0;
  for (size_t i = 0; i < outline.size(); i += step, ++num_depths) {
    outline[num_depths] = outline[i];
    half_ln_depths[num_depths] = half_ln_depths[i];
  }
  outline.resize(num_depths);
  half_ln_depths.resize(num_depths);
  // One word a square: of what is near there are many features in one, of what is far the raster's measurement alone.
  const auto cell = static_cast<float>(DepthRaster::kCellPx / view.camera.MeanFocalPx());
  std::map<std::pair<int, int>, RayEnd> ends;
  for (const Eigen::Vector3f& q : view.geometry.points()) {
    const Eigen::Vector2f ray(q.x() / q.z(), q.y() / q.z());
    if (!IsInside(hull, ray)) continue;
    const auto [nearest, farthest] = DepthsAround(ray, outline, half_ln_depths);
    const float half_ln_z = 0.5F * std::log(q.z());
    const RayEnd end = half_ln_z > farthest + kDepthTolerance  ? RayEnd::kPassed
                       : half_ln_z < nearest - kDepthTolerance ? RayEnd::kBlocked
                                                               : RayEnd::kHit;
    const std::pair square(static_cast<int>(std::floor(ray.x() / cell)), static_cast<int>(std::floor(ray.y() / cell)));
    const auto [entry, is_new] = ends.try_emplace(square, end);
    if (!is_new) entry->second = std::max(entry->second, end);
  }
  for (const auto& [square, end] : ends) {
    sighting.num_passed += end == RayEnd::kPassed ? 1 : 0;
    sighting.num_blocked += end == RayEnd::kBlocked ? 1 : 0;
    sighting.num_hits += end == RayEnd::kHit ? 1 : 0;
  }
  return sighting;
}

}  // namespace mapp
