#include "server/service/map_service_impl.h"

#include <fmt/format.h>

#include <algorithm>
#include <utility>

namespace mapp {

StatusOr<std::vector<MapRecord>> MapService::ListMaps(const CallContext& context) {
  MAPP_RETURN_IF_ERROR(context.Check());
  MAPP_ASSIGN_OR_RETURN(const std::unique_ptr<MapReader> reader, impl_->store.Read());
  return reader->ListMaps();
}

StatusOr<MapRecord> MapService::GetMap(const CallContext& context, const std::string& name) {
  MAPP_RETURN_IF_ERROR(context.Check());
  MAPP_ASSIGN_OR_RETURN(const std::unique_ptr<MapReader> reader, impl_->store.Read());
  return reader->FindMap(name);
}

StatusOr<std::vector<TileRecord>> MapService::ListTiles(const CallContext& context, MapId map) {
  MAPP_RETURN_IF_ERROR(context.Check());
  MAPP_ASSIGN_OR_RETURN(const std::unique_ptr<MapReader> reader, impl_->store.Read());
  return reader->ListTiles(map, std::nullopt);
}

StatusOr<MapRecord> MapService::DeleteMap(const CallContext& context, const std::string& name, bool force) {
  MapRecord map;
  const auto remove = [&](MapWriter& writer) -> Status {
    MAPP_ASSIGN_OR_RETURN(map, writer.FindMap(name));
    MAPP_ASSIGN_OR_RETURN(const std::vector<SessionRecord> sessions, writer.ListSessions(map.id));
    const auto num_open = std::count_if(sessions.begin(), sessions.end(),
                                        [](const SessionRecord& session) { return !session.closed_ns.has_value(); });
    if (num_open > 0 && !force) {
      return absl::FailedPreconditionError(fmt::format("map '{}' has {} open sessions", name, num_open));
    }
    return writer.DeleteMap(map.id);
  };
  const auto forget = [&] {
    impl_->tiles.OnMapDeleted(map.id);
    impl_->registrar.OnMapDeleted(map.id);
  };
  MAPP_RETURN_IF_ERROR(impl_->store.Write(context, remove, forget));
  return map;
}

StatusOr<std::vector<SessionRecord>> MapService::ListSessions(const CallContext& context, const std::string& map_name) {
  MAPP_RETURN_IF_ERROR(context.Check());
  MAPP_ASSIGN_OR_RETURN(const std::unique_ptr<MapReader> reader, impl_->store.Read());
  if (map_name.empty()) return reader->ListSessions(std::nullopt);
  MAPP_ASSIGN_OR_RETURN(const MapRecord map, reader->FindMap(map_name));
  return reader->ListSessions(map.id);
}

StatusOr<ReleasedSession> MapService::ReleaseSession(const CallContext& context, SessionId session) {
  ReleasedSession released;
  MAPP_ASSIGN_OR_RETURN(released.session, impl_->guard.Release(context, session));
  MAPP_ASSIGN_OR_RETURN(released.num_frames_taken_in, impl_->integrator.IntegrateLeftOut(context, session));
  if (!released.session.T_map_session) impl_->registrar.OnSessionReleased(released.session.map, session);
  return released;
}

Status MapService::ExportMap(const CallContext& context, const std::string& name,
                             const std::function<Status(const MapRecord&, const std::vector<FrameRecord>&)>& on_frames,
                             const std::function<Status(const std::vector<PointRecord>&)>& on_points) {
  MAPP_ASSIGN_OR_RETURN(const std::unique_ptr<MapReader> reader, impl_->store.Read());
  MAPP_ASSIGN_OR_RETURN(const MapRecord map, reader->FindMap(name));
  MAPP_ASSIGN_OR_RETURN(std::vector<FrameRecord> frames, reader->ListFrames(map.id, std::nullopt));
  // Poses of fragments are in frames of their own.
  std::erase_if(frames, [](const FrameRecord& frame) { return !frame.in_map; });
  MAPP_RETURN_IF_ERROR(on_frames(map, frames));
  MAPP_ASSIGN_OR_RETURN(const std::vector<TileRecord> tiles, reader->ListTiles(map.id, std::nullopt));
  for (const TileRecord& tile : tiles) {
    MAPP_RETURN_IF_ERROR(context.Check());
    MAPP_ASSIGN_OR_RETURN(const std::vector<PointRecord> points, reader->PointsInTile(map.id, tile.key));
    MAPP_RETURN_IF_ERROR(on_points(points));
  }
  return absl::OkStatus();
}

StatusOr<MapOptimizationFinished> MapService::OptimizeMap(const CallContext& context, const std::string& name,
                                                          const MapOptimizationObserver& on_progress) {
  MAPP_ASSIGN_OR_RETURN(const MapRecord map, GetMap(context, name));
  return impl_->optimizer.OptimizeMap(context, map.id, on_progress);
}

std::vector<StepFigures> MapService::StepTimesSoFar() const { return impl_->step_times.Snapshot(); }

}  // namespace mapp
