#include "server/service/session_retirement.h"

#include "server/service/frame_view.h"
#include "server/service/point_stats.h"
#include "storage/map_store.h"

#include <algorithm>
#include <set>
#include <unordered_map>
#include <unordered_set>

namespace mapp {
namespace {

class FrameRetirement {
 public:
  FrameRetirement(MapWriter& writer, const SessionRecord& session, RevisionCause cause)
      : writer_(writer), session_(session), cause_(cause) {}

  StatusOr<Retirement> Run(uint32_t first) {
    MAPP_ASSIGN_OR_RETURN(const std::vector<FrameRecord> frames, writer_.ListFrames(session_.map, session_.id));
    for (const FrameRecord& frame : frames) {
      if (!frame.in_map) continue;
      MAPP_RETURN_IF_ERROR(frame.number < first ? Keep(frame) : Retire(frame));
    }
    if (done_.frames.empty()) return std::move(done_);
    MAPP_ASSIGN_OR_RETURN(done_.revision, writer_.NextRevision(session_.map));
    MAPP_RETURN_IF_ERROR(writer_.SetCause(session_.map, cause_, session_.id));
    MAPP_RETURN_IF_ERROR(SettlePoints());
    MAPP_RETURN_IF_ERROR(NameNeighbors());
    done_.touched_tiles.assign(touched_.begin(), touched_.end());
    return std::move(done_);
  }

 private:
  Status Keep(const FrameRecord& frame) {
    MAPP_ASSIGN_OR_RETURN(const std::vector<Observation> observations, writer_.GetObservations(frame.id));
    for (const Observation& observation : observations) {
      kept_observers_.emplace(observation.point, frame.id);
      kept_own_.insert(observation.point);
    }
    return absl::OkStatus();
  }

  Status Retire(const FrameRecord& frame) {
    MAPP_ASSIGN_OR_RETURN(const FrameView view, LoadFrame(writer_, frame.id));
    for (size_t i = 0; i < view.points.size(); ++i) {
      if (!view.points[i]) continue;
      lost_[*view.points[i]].push_back({.frame = frame.id,
                                        .camera_center = frame.T_frame_camera.translation(),
                                        .focal_px = view.camera.MeanFocalPx(),
                                        .octave = view.keyframe.features[i].keypoint.octave});
    }
    done_.frames.push_back(frame.id);
    retired_.insert(frame.id);
    MAPP_RETURN_IF_ERROR(writer_.SetObservations(frame.id, {}));
    const Pose3 T_session_camera = session_.S_map_session().Inverse() * frame.T_frame_camera;
    return writer_.SetFramePose(frame.id, /*in_map=*/false, T_session_camera);
  }

  Status SettlePoints() {
    MAPP_ASSIGN_OR_RETURN(const MapRecord map, writer_.GetMap(session_.map));
    const TileGrid grid{map.tile_edge_m};
    std::vector<MapPointId> ids;
    for (const auto& [id, sightings] : lost_) ids.push_back(id);
    std::ranges::sort(ids);
    MAPP_ASSIGN_OR_RETURN(std::vector<PointRecord> points, writer_.FindPoints(ids));
    for (PointRecord& point : points) {
      std::erase_if(point.observers, [&](FrameId frame) { return retired_.contains(frame); });
    }
    MAPP_RETURN_IF_ERROR(FindUnlistedObservers(points));
    for (PointRecord& point : points) {
      touched_.insert(grid.KeyOf(point.position));
      MAPP_RETURN_IF_ERROR(Settle(point));
    }
    return absl::OkStatus();
  }

  /// A point lists some of its observers only: those that have lost all may have others.
  Status FindUnlistedObservers(const std::vector<PointRecord>& points) {
    std::unordered_set<MapPointId> unlisted;
    for (const PointRecord& point : points) {
      if (point.observers.empty() && !kept_observers_.contains(point.id)) unlisted.insert(point.id);
    }
    if (unlisted.empty()) return absl::OkStatus();
    MAPP_ASSIGN_OR_RETURN(const std::vector<FrameRecord> frames, writer_.ListFrames(session_.map, std::nullopt));
    for (const FrameRecord& frame : frames) {
      if (!frame.in_map || frame.session == session_.id) continue;
      MAPP_ASSIGN_OR_RETURN(const std::vector<Observation> observations, writer_.GetObservations(frame.id));
      for (const Observation& observation : observations) {
        if (unlisted.contains(observation.point)) kept_observers_.emplace(observation.point, frame.id);
      }
    }
    return absl::OkStatus();
  }

  Status Settle(PointRecord& point) {
    const auto kept = kept_observers_.find(point.id);
    if (point.observers.empty() && kept == kept_observers_.end() && point.session == session_.id) {
      ++done_.num_points;
      return writer_.RetirePoint(point.id, std::nullopt);
    }
    // A point that only others have left stays as it was founded.
    const bool is_founded_by_retired = point.session == session_.id && !kept_own_.contains(point.id);
    if (point.observers.empty() && kept != kept_observers_.end()) point.observers = {kept->second};
    left_observers_.insert(point.observers.begin(), point.observers.end());
    const std::vector<Sighting>& lost = lost_.at(point.id);
    if (!is_founded_by_retired) {
      std::for_each(lost.rbegin(), lost.rend(), [&](const Sighting& sighting) { RemoveObservation(point, sighting); });
    }
    return writer_.TouchPoint(point);
  }

  Status NameNeighbors() {
    for (const FrameId id : left_observers_) {
      MAPP_ASSIGN_OR_RETURN(const FrameRecord frame, writer_.GetFrame(id));
      if (frame.session != session_.id) done_.neighbors.insert(frame.session);
    }
    return absl::OkStatus();
  }

  MapWriter& writer_;
  const SessionRecord& session_;
  const RevisionCause cause_;
  Retirement done_;
  std::unordered_set<FrameId> retired_;
  std::unordered_map<MapPointId, std::vector<Sighting>> lost_;  ///< sightings by the retired frames, in their order
  std::unordered_map<MapPointId, FrameId> kept_observers_;      ///< one frame each that stays in the map
  std::unordered_set<MapPointId> kept_own_;                     ///< points that frames left of the session observe
  std::unordered_set<FrameId> left_observers_;
  std::set<TileKey> touched_;
};

}  // namespace

StatusOr<Retirement> RetireFrames(MapWriter& writer, const SessionRecord& session, uint32_t first,
                                  RevisionCause cause) {
  if (!session.T_map_session) return Retirement{};
  return FrameRetirement(writer, session, cause).Run(first);
}

}  // namespace mapp
