#include "mapp/view/sighted_points.h"

#include <algorithm>
#include <cmath>
#include <tuple>
#include <utility>

namespace mapp {
namespace {

/// Edge of a block: a fraction of a view's width where its points lie.
constexpr float kBlockM = 1;

std::tuple<int64_t, int64_t, int64_t> BlockOf(const Eigen::Vector3f& p) {
  const auto at = [](float value) { return static_cast<int64_t>(std::floor(value / kBlockM)); };
  return {at(p.x()), at(p.y()), at(p.z())};
}

}  // namespace

SightedTile::SightedTile(std::vector<SightedPoint> points) : points_(std::move(points)) {
  std::ranges::sort(points_, {}, [](const SightedPoint& point) { return std::pair(BlockOf(point.p_map), point.id); });
  for (size_t begin = 0, end = 0; begin < points_.size(); begin = end) {
    const auto block = BlockOf(points_[begin].p_map);
    Eigen::AlignedBox3f box_map;
    for (; end < points_.size() && BlockOf(points_[end].p_map) == block; ++end) box_map.extend(points_[end].p_map);
    blocks_.push_back(
        {box_map.center(), 0.5F * box_map.diagonal().norm(), static_cast<uint32_t>(begin), static_cast<uint32_t>(end)});
  }
}

}  // namespace mapp
