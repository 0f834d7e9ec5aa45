#include "server/service/map_scale.h"

#include "server/service/median.h"
#include "server/service/session_events.h"
#include "server/service/tile_cache.h"
#include "storage/map_store.h"

#include <bit>
#include <cmath>
#include <iterator>
#include <set>

namespace mapp {
namespace {

/// The map keeps its unit while its views' median depth is within this factor of the nominal one.
constexpr double kMaxOffNominal = 1.5;

Pose3 Scaled(const Pose3& pose, double scale) { return Pose3(pose.rotation(), scale * pose.translation()); }

/// Median depth of the points that a frame observes; nullopt when it observes none.
StatusOr<std::optional<double>> DepthOfView(MapReader& reader, const FrameRecord& frame) {
  MAPP_ASSIGN_OR_RETURN(const std::vector<Observation> observations, reader.GetObservations(frame.id));
  std::vector<MapPointId> ids;
  for (const Observation& observation : observations) ids.push_back(observation.point);
  MAPP_ASSIGN_OR_RETURN(const std::vector<PointRecord> points, reader.FindPoints(ids));
  const Pose3 T_camera_map = frame.T_frame_camera.Inverse();
  std::vector<double> depths_m;
  for (const PointRecord& point : points) {
    const double depth_m = (T_camera_map * point.position).z();
    if (depth_m > 0) depths_m.push_back(depth_m);
  }
  if (depths_m.empty()) return std::nullopt;
  return Median(std::move(depths_m));
}

Status RescaleFrames(MapWriter& writer, MapId map, double scale) {
  MAPP_ASSIGN_OR_RETURN(const std::vector<FrameRecord> frames, writer.ListFrames(map, std::nullopt));
  for (const FrameRecord& frame : frames) {
    // Those of fragments, and those left out of the map, are in their sessions' units.
    if (!frame.in_map) continue;
    MAPP_RETURN_IF_ERROR(writer.SetFramePose(frame.id, /*in_map=*/true, Scaled(frame.T_frame_camera, scale)));
  }
  return absl::OkStatus();
}

Status RescalePoints(MapWriter& writer, const MapRecord& map, double scale, std::set<TileKey>& tiles) {
  MAPP_ASSIGN_OR_RETURN(const std::vector<TileRecord> before, writer.ListTiles(map.id, std::nullopt));
  // All are read before one is written: a point that moves to a later tile would be met there again.
  std::vector<PointRecord> points;
  for (const TileRecord& tile : before) {
    MAPP_ASSIGN_OR_RETURN(std::vector<PointRecord> some, writer.PointsInTile(map.id, tile.key));
    points.insert(points.end(), std::make_move_iterator(some.begin()), std::make_move_iterator(some.end()));
    tiles.insert(tile.key);
  }
  const TileGrid grid{map.tile_edge_m};
  for (PointRecord& point : points) {
    point.position *= scale;
    point.reference_distance_m *= static_cast<float>(scale);
    MAPP_RETURN_IF_ERROR(writer.UpdatePoint(point));
    MAPP_RETURN_IF_ERROR(writer.TouchPoint(point));
    tiles.insert(grid.KeyOf(point.position));
  }
  return absl::OkStatus();
}

}  // namespace

StatusOr<RescaledMap> RescaleMap(MapWriter& writer, const MapRecord& map, double scale) {
  RescaledMap rescaled;
  MAPP_RETURN_IF_ERROR(RescaleFrames(writer, map.id, scale));
  std::set<TileKey> tiles;
  MAPP_RETURN_IF_ERROR(RescalePoints(writer, map, scale, tiles));
  rescaled.touched_tiles.assign(tiles.begin(), tiles.end());
  MAPP_ASSIGN_OR_RETURN(const std::vector<SessionRecord> sessions, writer.ListSessions(map.id));
  for (SessionRecord session : sessions) {
    if (!session.T_map_session) continue;
    session.T_map_session = Scaled(*session.T_map_session, scale);
    session.scale_map_session *= scale;
    MAPP_RETURN_IF_ERROR(writer.UpdateSession(session));
    rescaled.sessions.emplace_back(session.id, session.S_map_session());
  }
  return rescaled;
}

StatusOr<std::optional<RescaledMap>> KeepNominalScale(MapWriter& writer, const SessionRecord& session) {
  MAPP_ASSIGN_OR_RETURN(const MapRecord map, writer.GetMap(session.map));
  if (map.has_metric_scale || map.founder != session.id) return std::nullopt;
  MAPP_ASSIGN_OR_RETURN(std::vector<FrameRecord> frames, writer.ListFrames(map.id, session.id));
  std::erase_if(frames, [](const FrameRecord& frame) { return !frame.in_map; });
  if (!std::has_single_bit(frames.size())) return std::nullopt;
  std::vector<double> depths_m;
  for (const FrameRecord& frame : frames) {
    MAPP_ASSIGN_OR_RETURN(const std::optional<double> depth_m, DepthOfView(writer, frame));
    if (depth_m) depths_m.push_back(*depth_m);
  }
  if (depths_m.empty()) return std::nullopt;
  const double scale = kNominalDepthM / Median(std::move(depths_m));
  if (std::abs(std::log(scale)) < std::log(kMaxOffNominal)) return std::nullopt;
  return RescaleMap(writer, map, scale);
}

void AnnounceRescaled(TileCache& tiles, SessionEvents& events, MapId map, Revision revision,
                      const RescaledMap& rescaled) {
  tiles.Invalidate(map, rescaled.touched_tiles);
  events.PublishToMap(map, TilesChanged{.keys = rescaled.touched_tiles, .revision = revision});
  for (const auto& [session, S_map_session] : rescaled.sessions) {
    events.Publish(session,
                   SessionCorrected{.T_map_session = S_map_session.pose, .scale_map_session = S_map_session.scale});
  }
}

StatusOr<double> UnitOf(MapReader& reader, MapId map) {
  MAPP_ASSIGN_OR_RETURN(const MapRecord record, reader.GetMap(map));
  if (!record.founder) return 1.0;
  // The founder is the one session that is in the map for as long as its frame is.
  MAPP_ASSIGN_OR_RETURN(const SessionRecord founder, reader.GetSession(*record.founder));
  return founder.scale_map_session;
}

}  // namespace mapp
