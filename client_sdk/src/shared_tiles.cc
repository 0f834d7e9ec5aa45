#include "shared_tiles.h"

#include "mapp/base/bytes.h"
#include "mapp/codec/tile_codec.h"

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

std::shared_ptr<SharedMap> EmptyMap(const Pose3& T_map_session, uint32_t number) {
  auto map = std::make_shared<SharedMap>();
  map->T_map_session = T_map_session;
  map->number = number;
  return map;
}

void AddPoints(const Tile& tile, double focal_px, SharedMap& map) {
  const Pose3 T_session_map = map.T_map_session.Inverse();
  for (const TilePoint& point : tile.points) map.points.push_back(ToSharedPoint(point, T_session_map, focal_px));
}

}  // namespace

SharedTiles::SharedTiles(double tile_edge_m, size_t max_tiles, const Camera& camera, std::unique_ptr<TileFolder> folder)
    : grid_{.edge_m = tile_edge_m}, max_tiles_(max_tiles), focal_px_(camera.MeanFocalPx()), folder_(std::move(folder)) {
  if (folder_ == nullptr) return;
  const std::vector<TileKey> keys = folder_->Keys();
  in_folder_.insert(keys.begin(), keys.end());
}

bool SharedTiles::IsInReach(const TileKey& key, const Eigen::Vector3d& p_map, double reach_m) const {
  return grid_.BoxOf(key).exteriorDistance(p_map) <= reach_m;
}

std::vector<ClientHeldTile> SharedTiles::Held(const Eigen::Vector3d& p_map, double reach_m) {
  for (auto it = in_folder_.begin(); it != in_folder_.end();) {
    if (!IsInReach(*it, p_map, reach_m)) {
      ++it;
      continue;
    }
    if (auto entry = ReadFromFolder(*it)) tiles_.insert_or_assign(*it, *std::move(entry));
    it = in_folder_.erase(it);
  }
  std::vector<ClientHeldTile> held;
  for (const auto& [key, entry] : tiles_) {
    if (IsInReach(key, p_map, reach_m)) held.push_back({key, entry.revision, entry.crc32c});
  }
  return held;
}

std::optional<SharedTiles::Entry> SharedTiles::ReadFromFolder(const TileKey& key) const {
  std::optional<std::string> bytes = folder_->Read(key);
  if (!bytes) return std::nullopt;
  const StatusOr<TileHeader> header = DecodeTileHeader(*bytes);
  if (!header.ok() || header->key != key || header->edge_m != grid_.edge_m) {
    folder_->Remove(key);
    return std::nullopt;
  }
  const uint32_t crc32c = Crc32c(*bytes);
  return Entry{header->revision, crc32c, *std::move(bytes)};
}

void SharedTiles::Drop(const TileKey& key) {
  tiles_.erase(key);
  in_folder_.erase(key);
  if (folder_ != nullptr) folder_->Remove(key);
}

void SharedTiles::Forget(const std::map<TileKey, Revision>& changed) {
  for (const auto& [key, revision] : changed) {
    const auto held = tiles_.find(key);
    // What is in the folder alone is not read for it: at worst a tile that another device has just stored goes, too.
    if (held != tiles_.end() ? held->second.revision < revision : in_folder_.contains(key)) Drop(key);
  }
}

SharedTiles::Taken SharedTiles::Take(ClientSharedMap received, const std::vector<ClientHeldTile>& held) {
  Taken taken;
  for (ClientTile& tile : received.tiles) {
    const TileKey key = tile.tile.key;
    const Revision revision = tile.tile.revision;
    const uint32_t crc32c = Crc32c(tile.bytes);
    if (folder_ != nullptr) new_.push_back({key, std::move(tile.bytes)});
    in_folder_.erase(key);
    tiles_.insert_or_assign(key, Entry{revision, crc32c, std::move(tile.tile)});
    taken.keys.push_back(key);
  }
  for (const uint32_t idx : received.unchanged_held) {
    const auto found = tiles_.find(held.at(idx).key);
    if (found == tiles_.end()) continue;
    const bool from_folder = std::holds_alternative<std::string>(found->second.content);
    if (!Decode(found->second)) {
      Drop(found->first);
      continue;
    }
    taken.num_cached += from_folder ? 1 : 0;
    taken.keys.push_back(found->first);
  }
  for (const uint32_t idx : received.outdated_held) Drop(held.at(idx).key);
  return taken;
}

bool SharedTiles::Decode(Entry& entry) {
  const auto* bytes = std::get_if<std::string>(&entry.content);
  if (bytes == nullptr) return true;
  StatusOr<Tile> tile = DecodeTile(*bytes);
  if (!tile.ok()) return false;
  entry.content = *std::move(tile);
  return true;
}

Status SharedTiles::StoreNew() {
  Status first_error;
  for (const NewTile& tile : std::exchange(new_, {})) {
    const Status stored = folder_->Write(tile.key, tile.bytes);
    if (first_error.ok()) first_error = stored;
  }
  return first_error;
}

std::shared_ptr<const SharedMap> SharedTiles::MapOf(const std::vector<TileKey>& keys, const Pose3& T_map_session,
                                                    uint32_t number) const {
  auto map = EmptyMap(T_map_session, number);
  for (const TileKey& key : keys) AddPoints(std::get<Tile>(tiles_.at(key).content), focal_px_, *map);
  return map;
}

std::shared_ptr<const SharedMap> SharedTiles::MapOf(const std::vector<ClientTile>& tiles, const Pose3& T_map_session,
                                                    uint32_t number) const {
  auto map = EmptyMap(T_map_session, number);
  for (const ClientTile& tile : tiles) AddPoints(tile.tile, focal_px_, *map);
  return map;
}

const Tile* SharedTiles::Find(const TileKey& key) const {
  const auto found = tiles_.find(key);
  return found == tiles_.end() ? nullptr : std::get_if<Tile>(&found->second.content);
}

void SharedTiles::DropFarthest(const Eigen::Vector3d& p_map) {
  if (tiles_.size() <= max_tiles_) return;
  std::vector<std::pair<double, TileKey>> by_distance;
  by_distance.reserve(tiles_.size());
  for (const auto& [key, entry] : tiles_) {
    by_distance.emplace_back(grid_.BoxOf(key).squaredExteriorDistance(p_map), key);
  }
  const auto first_dropped = by_distance.begin() + static_cast<std::ptrdiff_t>(max_tiles_);
  std::nth_element(by_distance.begin(), first_dropped, by_distance.end());
  for (auto it = first_dropped; it != by_distance.end(); ++it) {
    tiles_.erase(it->second);
    if (folder_ != nullptr) in_folder_.insert(it->second);
  }
}

}  // namespace mapp
