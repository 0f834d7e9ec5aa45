#include "mapp/map/tile.h"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>

namespace mapp {
namespace {

constexpr int32_t kKeyBias = 1 << 20;
constexpr uint64_t kKeyMask = (uint64_t{1} << 21) - 1;

}  // namespace

uint64_t TileKey::Packed() const {
  const auto biased = [](int32_t v) { return static_cast<uint64_t>(static_cast<int64_t>(v) + kKeyBias) & kKeyMask; };
  return biased(x) << 42 | biased(y) << 21 | biased(z);
}

TileKey TileKey::FromPacked(uint64_t packed) {
  const auto unbiased = [](uint64_t v) { return static_cast<int32_t>(v & kKeyMask) - kKeyBias; };
  return {unbiased(packed >> 42), unbiased(packed >> 21), unbiased(packed)};
}

std::string TileKey::ToString() const { return fmt::format("{}/{}/{}", x, y, z); }

TileKey TileGrid::KeyOf(const Eigen::Vector3d& p_map) const {
  const auto index = [this](double v) {
    // Coordinates beyond the packed range cannot be uploaded (kMaxCoordinateM); clamping keeps the key valid anyway.
    const double cell = std::floor(v / edge_m);
    return static_cast<int32_t>(std::clamp(cell, -static_cast<double>(kKeyBias), static_cast<double>(kKeyBias - 1)));
  };
  return {index(p_map.x()), index(p_map.y()), index(p_map.z())};
}

Aabb TileGrid::BoxOf(const TileKey& key) const {
  const Eigen::Vector3d low = edge_m * Eigen::Vector3d(key.x, key.y, key.z);
  return Aabb(low, low + Eigen::Vector3d::Constant(edge_m));
}

std::vector<std::string> CheckConsistency(const Tile& tile) {
  std::vector<std::string> violations;
  const auto report = [&](std::string text) {
    violations.push_back(fmt::format("tile {}: {}", tile.key.ToString(), std::move(text)));
  };
  if (!(tile.edge_m > 0)) report(fmt::format("edge {} m is not positive", tile.edge_m));
  for (size_t i = 0; i < tile.frames.size(); ++i) {
    if (!tile.frames[i].T_map_camera.IsFinite()) report(fmt::format("frame {} has no finite pose", i));
  }
  const Aabb box = TileGrid{tile.edge_m}.BoxOf(tile.key);
  constexpr double kQuantisationM = 2e-3;
  for (const TilePoint& point : tile.points) {
    const uint64_t id = point.id.value();
    if (!point.p_map.allFinite()) {
      report(fmt::format("point {} is not finite", id));
    } else if (box.exteriorDistance(point.p_map.cast<double>()) > kQuantisationM) {
      report(fmt::format("point {} lies outside", id));
    }
    if (std::abs(point.view_direction.norm() - 1) > 0.05) report(fmt::format("point {} has no unit direction", id));
    if (!(point.confidence >= 0 && point.confidence <= 1)) report(fmt::format("point {} has a bad confidence", id));
    if (point.observers.size() > TilePoint::kMaxObservers) report(fmt::format("point {} has too many observers", id));
    for (const uint16_t observer : point.observers) {
      if (observer >= tile.frames.size()) report(fmt::format("point {} names observer {} of none", id, observer));
    }
  }
  return violations;
}

}  // namespace mapp
