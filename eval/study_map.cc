#include "eval/study_map.h"

#include "server/service/loaded_tile.h"
#include "server/service/point_stats.h"
#include "storage/map_store.h"

#include <algorithm>
#include <limits>
#include <unordered_map>
#include <utility>

namespace mapp {
namespace {

/// The frames that make the map, and what each point was seen by.
struct Observers {
  std::unordered_map<FrameId, ObserverFrame> frames;
  std::unordered_map<MapPointId, std::vector<FrameId>> of_point;
};

StatusOr<Observers> ReadObservers(MapReader& reader, MapId map, const std::set<SessionId>& without) {
  Observers observers;
  std::unordered_map<CameraId, float> fields_of_view;
  MAPP_ASSIGN_OR_RETURN(const std::vector<FrameRecord> frames, reader.ListFrames(map, std::nullopt));
  for (const FrameRecord& frame : frames) {
    if (!frame.in_map || without.contains(frame.session)) continue;
    if (!fields_of_view.contains(frame.camera)) {
      MAPP_ASSIGN_OR_RETURN(const CameraRecord camera, reader.GetCamera(frame.camera));
      fields_of_view[frame.camera] = static_cast<float>(camera.camera.FieldOfView());
    }
    observers.frames[frame.id] = {{frame.id, frame.T_frame_camera, fields_of_view[frame.camera]}, frame.session};
    MAPP_ASSIGN_OR_RETURN(const std::vector<Observation> observations, reader.GetObservations(frame.id));
    for (const Observation& observation : observations) observers.of_point[observation.point].push_back(frame.id);
  }
  return observers;
}

class Loader {
 public:
  Loader(const Observers& observers, StudyMap& study) : observers_(observers), study_(study) {}

  /// What has to be done to the tile as the store has it.
  TileChange Reduce(const TileKey& key, std::vector<PointRecord> points) {
    TileChange change;
    change.key = key;
    std::set<FrameId> used;
    for (PointRecord& point : points) {
      const auto seen_by = observers_.of_point.find(point.id);
      if (seen_by == observers_.of_point.end()) {
        change.removed.push_back(point.id);
        continue;
      }
      study_.points.push_back({point.position, point.descriptor, CentersOf(seen_by->second)});
      Observe(seen_by->second, point);
      used.insert(point.observers.begin(), point.observers.end());
      change.upserted.push_back(std::move(point));
    }
    for (const FrameId frame : used) change.frames.push_back(observers_.frames.at(frame));
    return change;
  }

 private:
  std::vector<Eigen::Vector3d> CentersOf(std::span<const FrameId> frames) const {
    std::vector<Eigen::Vector3d> centers;
    for (const FrameId frame : frames) centers.push_back(observers_.frames.at(frame).T_map_camera.translation());
    return centers;
  }

  /// The observers that the point would have, had these frames come one after the other.
  void Observe(std::span<const FrameId> frames, PointRecord& point) const {
    point.observers.clear();
    point.num_observations = 0;
    for (const FrameId frame : frames) {
      const std::vector<Eigen::Vector3d> present = CentersOf(point.observers);
      AddObservation(point, {frame, observers_.frames.at(frame).T_map_camera.translation()}, present);
    }
  }

  const Observers& observers_;
  StudyMap& study_;
};

}  // namespace

StatusOr<StudyMap> LoadMapWithout(MapStore& store, const MapRecord& map, const std::set<SessionId>& without) {
  StudyMap study;
  study.record = map;
  study.tiles = std::make_unique<TileCache>(store, std::numeric_limits<size_t>::max());
  MAPP_ASSIGN_OR_RETURN(const std::unique_ptr<MapReader> reader, store.Read());
  MAPP_ASSIGN_OR_RETURN(const Observers observers, ReadObservers(*reader, map.id, without));
  MAPP_ASSIGN_OR_RETURN(const std::vector<TileRecord> tiles, reader->ListTiles(map.id, std::nullopt));
  Loader loader(observers, study);
  for (const TileRecord& tile : tiles) {
    // The change is put on top of the tile in memory, as that of a commit would be; the store is not written.
    MAPP_RETURN_IF_ERROR(study.tiles->GetTile(map.id, tile.key).status());
    MAPP_ASSIGN_OR_RETURN(std::vector<PointRecord> points, reader->PointsInTile(map.id, tile.key));
    const TileChange change = loader.Reduce(tile.key, std::move(points));
    study.tiles->Apply(map.id, Revision(map.revision.value() + 1), std::span(&change, 1));
  }
  return study;
}

}  // namespace mapp
