// Changes of the world: found in a map's history, and decided on by operators.

#include "mapp/base/claim.h"
#include "server/changes/change_match.h"
#include "server/service/map_service_impl.h"

#include <fmt/format.h>

#include <algorithm>
#include <utility>

namespace mapp {
namespace {

Status CheckSearch(const ChangeSearch& search) {
  if (search.from_ns > search.to_ns) {
    return absl::InvalidArgumentError("from_unix_ns: must not be later than to_unix_ns");
  }
  if (search.auto_accept >= 0 && search.auto_accept <= 1) return absl::OkStatus();
  return absl::InvalidArgumentError(fmt::format("auto_accept: must be in [0, 1], got {}", search.auto_accept));
}

/// Writes what was found beside what is known, and tells of the outcome.
Status KeepChanges(MapWriter& writer, const MapRecord& map, const ChangeSearch& search,
                   std::vector<ChangeRecord> changes, DetectedChanges& detected, ChangeDecision& accepted) {
  MAPP_ASSIGN_OR_RETURN(const std::vector<ChangeRecord> stored, writer.ListChanges(map.id));
  ChangeUpdate update = MatchChanges(stored, std::move(changes), search.from_ns, search.to_ns);
  detected.num_new = update.fresh.size();
  detected.num_dropped = update.dropped.size();
  for (const ChangeId id : update.dropped) MAPP_RETURN_IF_ERROR(writer.DeleteChange(id));
  detected.changes = std::move(update.known);
  std::ranges::move(update.fresh, std::back_inserter(detected.changes));
  std::vector<ChangeId> sure;
  for (ChangeRecord& change : detected.changes) {
    if (change.status != ChangeStatus::kProposed) continue;
    MAPP_ASSIGN_OR_RETURN(change.id, writer.PutChange(change));
    if (search.auto_accept > 0 && change.confidence >= search.auto_accept) sure.push_back(change.id);
  }
  MAPP_ASSIGN_OR_RETURN(accepted, AcceptChanges(writer, map, sure));
  detected.num_accepted = sure.size();
  for (const ChangeRecord& change : accepted.changes) {
    *std::ranges::find(detected.changes, change.id, &ChangeRecord::id) = change;
  }
  std::ranges::sort(detected.changes, {}, &ChangeRecord::id);
  return absl::OkStatus();
}

}  // namespace

Status MapService::Impl::Decide(const CallContext& context, const std::string& map_name, ChangeDecision& decision,
                                const std::function<StatusOr<ChangeDecision>(MapWriter&, const MapRecord&)>& decide) {
  MapId map;
  const auto write = [&](MapWriter& writer) -> Status {
    MAPP_ASSIGN_OR_RETURN(const MapRecord record, writer.FindMap(map_name));
    map = record.id;
    MAPP_ASSIGN_OR_RETURN(decision, decide(writer, record));
    return absl::OkStatus();
  };
  return store.Write(context, write, [&] { Announce(map, decision); });
}

void MapService::Impl::Announce(MapId map, const ChangeDecision& decision) {
  if (decision.touched_tiles.empty()) return;
  const std::vector<TileKey> keys(decision.touched_tiles.begin(), decision.touched_tiles.end());
  tiles.Invalidate(map, keys);
  events.PublishToMap(map, TilesChanged{.keys = keys, .revision = decision.revision});
}

StatusOr<ThingMemory*> MapService::Impl::MemoryOf(const std::string& map_name) {
  MAPP_ASSIGN_OR_RETURN(const std::unique_ptr<MapReader> reader, store.Read());
  MAPP_ASSIGN_OR_RETURN(const MapRecord map, reader->FindMap(map_name));
  MAPP_ASSIGN_OR_RETURN(const std::vector<MapRecord> maps, reader->ListMaps());
  std::erase_if(thing_memory, [&](const auto& of_map) {
    return std::ranges::find(maps, of_map.first, &MapRecord::id) == maps.end();
  });
  return &thing_memory[map.id];
}

StatusOr<DetectedChanges> MapService::DetectChanges(const CallContext& context, const ChangeSearch& search,
                                                    const std::function<void(const ScanProgress&)>& on_progress) {
  MAPP_RETURN_IF_ERROR(CheckSearch(search));
  const Claim claim(impl_->detecting);
  if (!claim.is_mine()) {
    return absl::FailedPreconditionError("changes are being detected for another caller; ask again when it is done");
  }
  ScanOptions options = impl_->scan_options;
  options.derivation.from_ns = search.from_ns;
  options.derivation.to_ns = search.to_ns;
  MAPP_ASSIGN_OR_RETURN(ThingMemory* const memory, impl_->MemoryOf(search.map_name));
  MAPP_ASSIGN_OR_RETURN(ChangeScan scan,
                        ScanForChanges(context, impl_->store, search.map_name, options, *memory, on_progress));
  DetectedChanges detected;
  ChangeDecision accepted;
  const auto keep = [&](MapWriter& writer) -> Status {
    detected = {};
    detected.num_sessions = scan.num_sessions;
    detected.num_sessions_read = scan.num_sessions_read;
    MAPP_ASSIGN_OR_RETURN(const MapRecord map, writer.GetMap(scan.map.id));
    return KeepChanges(writer, map, search, scan.changes, detected, accepted);
  };
  MAPP_RETURN_IF_ERROR(impl_->store.Write(context, keep, [&] { impl_->Announce(scan.map.id, accepted); }));
  return detected;
}

StatusOr<std::vector<ChangeRecord>> MapService::ListChanges(const CallContext& context, const std::string& map_name) {
  MAPP_RETURN_IF_ERROR(context.Check());
  MAPP_ASSIGN_OR_RETURN(const std::unique_ptr<MapReader> reader, impl_->store.Read());
  MAPP_ASSIGN_OR_RETURN(const MapRecord map, reader->FindMap(map_name));
  return reader->ListChanges(map.id);
}

StatusOr<ChangeDecision> MapService::AcceptChanges(const CallContext& context, const std::string& map_name,
                                                   std::span<const ChangeId> ids) {
  ChangeDecision decision;
  MAPP_RETURN_IF_ERROR(impl_->Decide(context, map_name, decision, [&](MapWriter& writer, const MapRecord& map) {
    return mapp::AcceptChanges(writer, map, ids);
  }));
  return decision;
}

StatusOr<ChangeDecision> MapService::RejectChanges(const CallContext& context, const std::string& map_name,
                                                   std::span<const ChangeId> ids) {
  ChangeDecision decision;
  MAPP_RETURN_IF_ERROR(impl_->Decide(context, map_name, decision, [&](MapWriter& writer, const MapRecord& map) {
    return mapp::RejectChanges(writer, map, ids);
  }));
  return decision;
}

StatusOr<ChangeDecision> MapService::UndoChanges(const CallContext& context, const std::string& map_name,
                                                 std::span<const ChangeId> ids) {
  ChangeDecision decision;
  MAPP_RETURN_IF_ERROR(impl_->Decide(context, map_name, decision, [&](MapWriter& writer, const MapRecord& map) {
    return mapp::UndoChanges(writer, impl_->store, map, ids);
  }));
  return decision;
}

}  // namespace mapp
