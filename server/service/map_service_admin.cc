#include "mapp/base/unix_time.h"
#include "server/service/map_history.h"
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

StatusOr<MapState> MapService::GetMap(const CallContext& context, const std::string& name, const std::string& at) {
  MAPP_RETURN_IF_ERROR(context.Check());
  MAPP_ASSIGN_OR_RETURN(const std::unique_ptr<MapReader> reader, ReadMapAt(impl_->store, name, at));
  MapState state;
  MAPP_ASSIGN_OR_RETURN(state.record, reader->FindMap(name));
  MAPP_ASSIGN_OR_RETURN(state.tiles, reader->ListTiles(state.record.id, std::nullopt));
  return state;
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

Status MapService::ExportMap(const CallContext& context, const std::string& name, const std::string& at,
                             const std::function<Status(const MapRecord&, const std::vector<FrameRecord>&)>& on_frames,
                             const std::function<Status(const std::vector<PointRecord>&)>& on_points) {
  MAPP_ASSIGN_OR_RETURN(const std::unique_ptr<MapReader> reader, ReadMapAt(impl_->store, name, at));
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
  MAPP_ASSIGN_OR_RETURN(const MapId map, FindMap(impl_->store, name));
  return impl_->optimizer.OptimizeMap(context, map, on_progress);
}

StatusOr<RevisionLog> MapService::ListRevisions(const CallContext& context, const std::string& name, size_t max_runs) {
  MAPP_RETURN_IF_ERROR(context.Check());
  MAPP_ASSIGN_OR_RETURN(const std::unique_ptr<MapReader> reader, impl_->store.Read());
  return ReadRevisionLog(*reader, name, max_runs);
}

StatusOr<MapDiff> MapService::DiffRevisions(const CallContext& context, const std::string& name,
                                            const std::string& from, const std::string& to) {
  MAPP_RETURN_IF_ERROR(context.Check());
  MAPP_ASSIGN_OR_RETURN(const std::unique_ptr<MapReader> reader, impl_->store.Read());
  return ReadMapDiff(*reader, name, from, to);
}

StatusOr<std::vector<TagRecord>> MapService::ListTags(const CallContext& context, const std::string& name) {
  MAPP_RETURN_IF_ERROR(context.Check());
  MAPP_ASSIGN_OR_RETURN(const std::unique_ptr<MapReader> reader, impl_->store.Read());
  MAPP_ASSIGN_OR_RETURN(const MapRecord map, reader->FindMap(name));
  return reader->ListTags(map.id);
}

StatusOr<Revision> MapService::PutTag(const CallContext& context, const std::string& name, const std::string& tag,
                                      const std::string& at) {
  Revision revision;
  MAPP_RETURN_IF_ERROR(impl_->store.Write(context, [&](MapWriter& writer) -> Status {
    MAPP_ASSIGN_OR_RETURN(const MapRecord map, writer.FindMap(name));
    MAPP_ASSIGN_OR_RETURN(revision, ResolveRevision(writer, map, at));
    return writer.PutTag(map.id, tag, revision);
  }));
  return revision;
}

Status MapService::DeleteTag(const CallContext& context, const std::string& name, const std::string& tag) {
  return impl_->store.Write(context, [&](MapWriter& writer) -> Status {
    MAPP_ASSIGN_OR_RETURN(const MapRecord map, writer.FindMap(name));
    return writer.DeleteTag(map.id, tag);
  });
}

StatusOr<Compaction> MapService::CompactMap(const CallContext& context, const CompactionRequest& request,
                                            const CompactionObserver& on_progress) {
  return mapp::CompactMap(impl_->store, context, request, UnixNowNs(), on_progress);
}

Status MapService::ExportBundle(const CallContext& context, const std::string& name, const std::string& at,
                                ByteSink sink, const BundleExportObserver& on_progress) {
  MAPP_ASSIGN_OR_RETURN(const std::unique_ptr<MapReader> reader, ReadMapAt(impl_->store, name, at));
  MAPP_ASSIGN_OR_RETURN(const MapRecord map, reader->FindMap(name));
  return mapp::ExportBundle(context, *reader, map, UnixNowNs(), std::move(sink), on_progress);
}

Status MapService::CheckNameIsFree(const std::string& name) {
  MAPP_ASSIGN_OR_RETURN(const std::unique_ptr<MapReader> reader, impl_->store.Read());
  return mapp::CheckNameIsFree(*reader, name);
}

StatusOr<ImportedMap> MapService::ImportBundle(const CallContext& context, BundleFile& bundle, const std::string& name,
                                               const BundleImportObserver& on_progress) {
  StatusOr<ImportedMap> imported = mapp::ImportBundle(context, impl_->store, bundle, name, on_progress);
  if (!imported.ok()) return imported;
  impl_->registrar.OnMapImported(imported->map.id);
  for (const SessionId session : imported->owed) impl_->registrar.OnSessionClosed(imported->map.id, session);
  return imported;
}

std::vector<StepFigures> MapService::StepTimesSoFar() const { return impl_->step_times.Snapshot(); }

}  // namespace mapp
