#include "shared_tiles.h"

#include <algorithm>
#include <utility>

namespace mapp {
namespace {

SharedPoint ToSharedPoint(const TilePoint& point, const Pose3& T_session_map, double focal_px) {
  const Eigen::Vector3d direction = T_session_map.rotation() * point.view_direction.cast<double>();
  return {.id = point.id,
          .p_session = T_session_map * point.p_map.cast<double>(),
          .view_direction_session = direction.cast<float>(),
          .descriptor = point.descriptor,
          .reference_distance_m = ReferenceFor(focal_px, point.reference_distance_m),
          .num_observations = point.num_observations};
}

}  // namespace

std::vector<ClientHeldTile> SharedTiles::Held() const {
  std::vector<ClientHeldTile> held;
  held.reserve(tiles_.size());
  for (const auto& [key, tile] : tiles_) held.push_back({.key = key, .revision = tile.revision});
  return held;
}

void SharedTiles::Forget(const std::map<TileKey, Revision>& changed) {
  std::erase_if(tiles_, [&](const auto& held) {
    const auto change = changed.find(held.first);
    return change != changed.end() && held.second.revision < change->second;
  });
}

void SharedTiles::Put(std::vector<Tile> tiles) {
  for (Tile& tile : tiles) {
    const TileKey key = tile.key;
    tiles_.insert_or_assign(key, std::move(tile));
  }
}

std::shared_ptr<const SharedMap> SharedTiles::MapInView(const ViewCone& cone, const Pose3& T_map_session,
                                                        uint32_t number) {
  DropFarthest(cone.T_map_camera.translation());
  auto map = std::make_shared<SharedMap>();
  map->T_map_session = T_map_session;
  map->number = number;
  const Pose3 T_session_map = T_map_session.Inverse();
  for (const TileKey& key : TilesInView(cone, grid_)) {
    const auto found = tiles_.find(key);
    if (found == tiles_.end()) continue;
    for (const TilePoint& point : found->second.points)
      map->points.push_back(ToSharedPoint(point, T_session_map, focal_px_));
  }
  return map;
}

void SharedTiles::DropFarthest(const Eigen::Vector3d& center_map) {
  if (tiles_.size() <= max_tiles_) return;
  std::vector<std::pair<double, TileKey>> by_distance;
  by_distance.reserve(tiles_.size());
  for (const auto& [key, tile] : tiles_) {
    by_distance.emplace_back(grid_.BoxOf(key).squaredExteriorDistance(center_map), key);
  }
  const auto first_dropped = by_distance.begin() + static_cast<std::ptrdiff_t>(max_tiles_);
  std::nth_element(by_distance.begin(), first_dropped, by_distance.end());
  for (auto it = first_dropped; it != by_distance.end(); ++it) tiles_.erase(it->second);
}

}  // namespace mapp
