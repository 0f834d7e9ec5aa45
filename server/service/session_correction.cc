#include "server/service/session_correction.h"

#include "server/service/map_scale.h"
#include "server/service/tile_cache.h"

#include <fmt/format.h>

#include <algorithm>
#include <set>
#include <unordered_set>

namespace mapp {
namespace {

/// The correction of one session, as a change to the store.
class Correction {
 public:
  Correction(SessionId session, const Placement& placement) : session_(session), placement_(placement) {}

  Status Run(MapWriter& writer) {
    MAPP_ASSIGN_OR_RETURN(SessionRecord session, writer.GetSession(session_));
    if (!session.T_map_session || session.IsQuarantined()) return absl::OkStatus();
    map_ = session.map;
    MAPP_ASSIGN_OR_RETURN(const double map_unit, UnitOf(writer, map_));
    if (map_unit != placement_.map_unit) {
      return absl::AbortedError(fmt::format("map {} has been rescaled", map_.value()));
    }
    MAPP_ASSIGN_OR_RETURN(revision_, writer.NextRevision(map_));
    MAPP_RETURN_IF_ERROR(writer.SetCause(map_, RevisionCause::kAlignment, session_));
    const Sim3 S_session_map = session.S_map_session().Inverse();
    MAPP_RETURN_IF_ERROR(MoveFrames(writer, S_session_map));
    MAPP_RETURN_IF_ERROR(MovePoints(writer, S_session_map));
    session.T_map_session = placement_.S_map_session.pose;
    session.scale_map_session = placement_.S_map_session.scale;
    moved_ = true;
    return writer.UpdateSession(session);
  }

  bool moved() const { return moved_; }
  MapId map() const { return map_; }
  Revision revision() const { return revision_; }
  std::vector<TileKey> touched_tiles() const { return {tiles_.begin(), tiles_.end()}; }

 private:
  Status MoveFrames(MapWriter& writer, const Sim3& S_session_map) {
    MAPP_ASSIGN_OR_RETURN(const std::vector<FrameRecord> frames, writer.ListFrames(map_, session_));
    for (const FrameRecord& frame : frames) {
      if (!frame.in_map) continue;
      frames_.insert(frame.id);
      const Pose3 T_session_camera = S_session_map * frame.T_frame_camera;
      MAPP_RETURN_IF_ERROR(writer.SetFramePose(frame.id, /*in_map=*/true, placement_.S_map_session * T_session_camera));
    }
    return absl::OkStatus();
  }

  Status MovePoints(MapWriter& writer, const Sim3& S_session_map) {
    MAPP_ASSIGN_OR_RETURN(const MapRecord map, writer.GetMap(map_));
    const TileGrid grid{map.tile_edge_m};
    MAPP_ASSIGN_OR_RETURN(const std::vector<PointRecord> points, writer.PointsOfSession(session_));
    const Sim3& S_map_session = placement_.S_map_session;
    for (PointRecord point : points) {
      const bool is_own =
          std::ranges::all_of(point.observers, [this](FrameId frame) { return frames_.contains(frame); });
      if (!point.in_map || !is_own) continue;
      tiles_.insert(grid.KeyOf(point.position));
      const Eigen::Quaterniond R = S_map_session.pose.rotation() * S_session_map.pose.rotation();
      point.position = S_map_session * (S_session_map * point.position);
      point.view_direction = (R * point.view_direction.cast<double>()).cast<float>();
      point.reference_distance_m *= static_cast<float>(S_map_session.scale * S_session_map.scale);
      MAPP_RETURN_IF_ERROR(writer.UpdatePoint(point));
      MAPP_RETURN_IF_ERROR(writer.TouchPoint(point));
      tiles_.insert(grid.KeyOf(point.position));
    }
    return absl::OkStatus();
  }

  const SessionId session_;
  const Placement placement_;
  std::unordered_set<FrameId> frames_;
  std::set<TileKey> tiles_;
  MapId map_;
  Revision revision_;
  bool moved_ = false;
};

}  // namespace

Status CorrectSession(MapStore& store, TileCache& tiles, SessionEvents& events, const CallContext& context,
                      SessionId session, const Placement& placement) {
  Correction correction(session, placement);
  return store.Write(
      context, [&](MapWriter& writer) { return correction.Run(writer); },
      [&] {
        if (!correction.moved()) return;
        const std::vector<TileKey> touched = correction.touched_tiles();
        tiles.Invalidate(correction.map(), touched);
        events.PublishToMap(correction.map(), TilesChanged{.keys = touched, .revision = correction.revision()});
        events.Publish(session, SessionCorrected{.T_map_session = placement.S_map_session.pose,
                                                 .scale_map_session = placement.S_map_session.scale});
      });
}

}  // namespace mapp
