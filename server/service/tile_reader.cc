#include "server/service/tile_reader.h"

#include "storage/map_store.h"

#include <algorithm>
#include <limits>
#include <set>
#include <unordered_map>
#include <utility>

namespace mapp {
namespace {

StatusOr<std::vector<ObserverFrame>> ReadFrames(MapReader& reader, const std::set<FrameId>& ids) {
  std::unordered_map<CameraId, float> fields_of_view;
  std::vector<ObserverFrame> frames;
  frames.reserve(ids.size());
  for (const FrameId id : ids) {
    MAPP_ASSIGN_OR_RETURN(const FrameRecord frame, reader.GetFrame(id));
    if (!fields_of_view.contains(frame.camera)) {
      MAPP_ASSIGN_OR_RETURN(const CameraRecord camera, reader.GetCamera(frame.camera));
      fields_of_view[frame.camera] = static_cast<float>(camera.camera.FieldOfView());
    }
    frames.push_back({{id, frame.T_frame_camera, fields_of_view[frame.camera]}, frame.session});
  }
  return frames;
}

TilePoint MakePoint(const PointRecord& record, const std::unordered_map<FrameId, uint16_t>& frame_index) {
  TilePoint point;
  point.id = record.id;
  point.p_map = record.position.cast<float>();
  point.descriptor = record.descriptor;
  point.view_direction = record.view_direction;
  point.reference_distance_m = record.reference_distance_m;
  constexpr uint32_t kMaxCount = std::numeric_limits<uint16_t>::max();
  point.num_observations = static_cast<uint16_t>(std::min(record.num_observations, kMaxCount));
  point.confidence = record.confidence;
  for (const FrameId observer : record.observers) {
    const auto found = frame_index.find(observer);
    if (found != frame_index.end() && point.observers.size() < TilePoint::kMaxObservers) {
      point.observers.push_back(found->second);
    }
  }
  return point;
}

}  // namespace

StatusOr<TileContent> ReadTile(MapReader& reader, MapId map, const TileKey& key) {
  TileContent content;
  MAPP_ASSIGN_OR_RETURN(content.points, reader.PointsInTile(map, key));
  std::set<FrameId> observers;
  for (const PointRecord& point : content.points) observers.insert(point.observers.begin(), point.observers.end());
  MAPP_ASSIGN_OR_RETURN(content.frames, ReadFrames(reader, observers));
  return content;
}

Tile MakeTile(const TileKey& key, double edge_m, Revision revision, const TileContent& content) {
  Tile tile;
  tile.key = key;
  tile.edge_m = edge_m;
  tile.revision = revision;
  constexpr size_t kMaxFrames = size_t{std::numeric_limits<uint16_t>::max()} + 1;
  std::unordered_map<FrameId, uint16_t> frame_index;
  for (const ObserverFrame& frame : content.frames) {
    if (tile.frames.size() == kMaxFrames) break;
    frame_index.emplace(frame.id, static_cast<uint16_t>(tile.frames.size()));
    tile.frames.push_back(frame);
  }
  tile.points.reserve(content.points.size());
  for (const PointRecord& point : content.points) tile.points.push_back(MakePoint(point, frame_index));
  return tile;
}

Aabb InnerBox(const TileKey& key, double edge_m) {
  const Aabb cube = TileGrid{edge_m}.BoxOf(key);
  const Eigen::Vector3d margin = Eigen::Vector3d::Constant(0.25 * edge_m);
  return {cube.min() + margin, cube.max() - margin};
}

}  // namespace mapp
