#include "server/changes/point_tiles.h"

#include "storage/map_store.h"

#include <utility>

namespace mapp {

PointTiles::PointTiles(MapReader& reader, Mutex& mutex, const MapRecord& map, std::span<const FrameRecord> frames,
                       size_t max_kept_points)
    : mutex_(mutex), reader_(reader), map_(map.id), grid_{map.tile_edge_m}, max_kept_points_(max_kept_points) {
  for (const FrameRecord& frame : frames) centers_.emplace(frame.id, frame.T_frame_camera.translation().cast<float>());
}

StatusOr<std::vector<PointTiles::Points>> PointTiles::InBox(const Aabb& box_map) {
  std::vector<Points> found;
  if (box_map.isEmpty()) return found;
  const TileKey first = grid_.KeyOf(box_map.min()), last = grid_.KeyOf(box_map.max());
  for (int32_t x = first.x; x <= last.x; ++x) {
    for (int32_t y = first.y; y <= last.y; ++y) {
      for (int32_t z = first.z; z <= last.z; ++z) {
        MAPP_ASSIGN_OR_RETURN(Points points, Get({x, y, z}));
        if (!points->points().empty()) found.push_back(std::move(points));
      }
    }
  }
  return found;
}

StatusOr<PointTiles::Points> PointTiles::Get(const TileKey& key) {
  const MutexLock lock(mutex_);
  if (const auto found = index_.find(key); found != index_.end()) {
    kept_.splice(kept_.begin(), kept_, found->second);
    return found->second->points;
  }
  MAPP_ASSIGN_OR_RETURN(const std::vector<PointRecord> records, reader_.PointsInTile(map_, key));
  auto points = std::make_shared<const SightedTile>(Sighted(records));
  kept_.push_front({key, points});
  index_[key] = kept_.begin();
  num_kept_points_ += points->points().size();
  while (num_kept_points_ > max_kept_points_ && kept_.size() > 1) {
    num_kept_points_ -= kept_.back().points->points().size();
    index_.erase(kept_.back().key);
    kept_.pop_back();
  }
  return Points(std::move(points));
}

SightedTile PointTiles::Sighted(std::span<const PointRecord> records) const {
  std::vector<SightedPoint> points;
  points.reserve(records.size());
  for (const PointRecord& record : records) {
    SightedPoint point;
    point.p_map = record.position.cast<float>();
    point.reference_distance_m = record.reference_distance_m;
    point.id = record.id;
    point.founder = record.session;
    for (const FrameId observer : record.observers) {
      const auto center = centers_.find(observer);
      if (center == centers_.end() || point.num_directions == point.directions.size()) continue;
      point.directions[point.num_directions++] = (point.p_map - center->second).normalized();
    }
    points.push_back(point);
  }
  return SightedTile(std::move(points));
}

}  // namespace mapp
