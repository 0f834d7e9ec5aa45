#include "server/service/change_decision.h"

#include "storage/map_store.h"

#include <fmt/format.h>

#include <algorithm>
#include <map>
#include <memory>
#include <utility>

namespace mapp {
namespace {

/// By id, none twice.
StatusOr<std::vector<ChangeRecord>> GetChanges(MapWriter& writer, const MapRecord& map, std::span<const ChangeId> ids) {
  const std::set<ChangeId> wanted(ids.begin(), ids.end());
  std::vector<ChangeRecord> changes;
  for (const ChangeId id : wanted) {
    MAPP_ASSIGN_OR_RETURN(ChangeRecord change, GetChangeOf(writer, map, id));
    changes.push_back(std::move(change));
  }
  return changes;
}

/// Starts the revision when the first point changes.
class PointDecision {
 public:
  PointDecision(MapWriter& writer, const MapRecord& map, RevisionCause cause, ChangeDecision& decision)
      : writer_(writer), map_(map), cause_(cause), decision_(decision) {}

  Status Retire(const PointRecord& point) {
    MAPP_RETURN_IF_ERROR(Begin(point));
    return writer_.RetirePoint(point.id, std::nullopt);
  }
  Status Return(const PointRecord& point) {
    MAPP_RETURN_IF_ERROR(Begin(point));
    return writer_.ReturnPoint(point);
  }

 private:
  Status Begin(const PointRecord& point) {
    if (decision_.revision == Revision(0)) {
      MAPP_ASSIGN_OR_RETURN(decision_.revision, writer_.NextRevision(map_.id));
      MAPP_RETURN_IF_ERROR(writer_.SetCause(map_.id, cause_, std::nullopt));
    }
    ++decision_.num_points;
    decision_.touched_tiles.insert(TileGrid{map_.tile_edge_m}.KeyOf(point.position));
    return absl::OkStatus();
  }

  MapWriter& writer_;
  const MapRecord& map_;
  const RevisionCause cause_;
  ChangeDecision& decision_;
};

/// Points as they were before acceptances ended them, but for who has left the map since.
class Returner {
 public:
  Returner(MapWriter& writer, MapStore& store) : writer_(writer), store_(store) {}

  StatusOr<std::vector<PointRecord>> PointsBefore(const ChangeRecord& change) {
    const Revision before(change.applied->value() - 1);
    MAPP_ASSIGN_OR_RETURN(const std::unique_ptr<MapReader> past, store_.ReadAsOf(change.map, before));
    MAPP_ASSIGN_OR_RETURN(const std::vector<PointRecord> points, past->FindPoints(change.points_before));
    std::vector<PointRecord> returned;
    for (PointRecord point : points) {
      std::vector<FrameId> observers;
      for (const FrameId frame : point.observers) {
        MAPP_ASSIGN_OR_RETURN(const bool in_map, IsInMap(frame));
        if (in_map) observers.push_back(frame);
      }
      if (observers.empty()) continue;  // nobody who stands in the map has seen it
      point.observers = std::move(observers);
      returned.push_back(std::move(point));
    }
    return returned;
  }

 private:
  StatusOr<bool> IsInMap(FrameId frame) {
    const auto [known, is_new] = in_map_.try_emplace(frame, false);
    if (!is_new) return known->second;
    const StatusOr<FrameRecord> record = writer_.GetFrame(frame);
    if (!record.ok() && !absl::IsNotFound(record.status())) return record.status();
    return known->second = record.ok() && record->in_map;
  }

  MapWriter& writer_;
  MapStore& store_;
  std::map<FrameId, bool> in_map_;
};

}  // namespace

StatusOr<ChangeRecord> GetChangeOf(MapWriter& writer, const MapRecord& map, ChangeId change) {
  StatusOr<ChangeRecord> found = writer.GetChange(change);
  if (found.ok() && found->map == map.id) return found;
  if (!found.ok() && !absl::IsNotFound(found.status())) return found.status();
  return absl::NotFoundError(
      fmt::format("ids: map \"{}\" has no change {}; `mapp changes list` names them", map.name, change.value()));
}

StatusOr<ChangeDecision> AcceptChanges(MapWriter& writer, const MapRecord& map, std::span<const ChangeId> ids) {
  ChangeDecision decision;
  MAPP_ASSIGN_OR_RETURN(decision.changes, GetChanges(writer, map, ids));
  PointDecision points(writer, map, RevisionCause::kChange, decision);
  std::vector<ChangeRecord*> accepted;
  for (ChangeRecord& change : decision.changes) {
    if (change.status == ChangeStatus::kAccepted) continue;
    if (change.status == ChangeStatus::kRejected) {
      return absl::FailedPreconditionError(
          fmt::format("change {} of map \"{}\" is rejected; undo that first", change.id.value(), map.name));
    }
    accepted.push_back(&change);
    MAPP_ASSIGN_OR_RETURN(const std::vector<PointRecord> live, writer.FindPoints(change.points_before));
    for (const PointRecord& point : live) MAPP_RETURN_IF_ERROR(points.Retire(point));
    // What had ended otherwise is not brought back by undoing this.
    change.points_before.clear();
    for (const PointRecord& point : live) change.points_before.push_back(point.id);
    std::ranges::sort(change.points_before);
    change.status = ChangeStatus::kAccepted;
  }
  for (ChangeRecord* change : accepted) {
    if (decision.revision != Revision(0) && !change->points_before.empty()) change->applied = decision.revision;
    MAPP_RETURN_IF_ERROR(writer.PutChange(*change).status());
  }
  return decision;
}

StatusOr<ChangeDecision> RejectChanges(MapWriter& writer, const MapRecord& map, std::span<const ChangeId> ids) {
  ChangeDecision decision;
  MAPP_ASSIGN_OR_RETURN(decision.changes, GetChanges(writer, map, ids));
  for (ChangeRecord& change : decision.changes) {
    if (change.status == ChangeStatus::kAccepted) {
      return absl::FailedPreconditionError(
          fmt::format("change {} of map \"{}\" is accepted; undo that first", change.id.value(), map.name));
    }
    change.status = ChangeStatus::kRejected;
    MAPP_RETURN_IF_ERROR(writer.PutChange(change).status());
  }
  return decision;
}

StatusOr<ChangeDecision> UndoChanges(MapWriter& writer, MapStore& store, const MapRecord& map,
                                     std::span<const ChangeId> ids) {
  ChangeDecision decision;
  MAPP_ASSIGN_OR_RETURN(decision.changes, GetChanges(writer, map, ids));
  PointDecision points(writer, map, RevisionCause::kChangeUndone, decision);
  Returner returner(writer, store);
  for (ChangeRecord& change : decision.changes) {
    if (change.status == ChangeStatus::kProposed) continue;
    if (change.applied) {
      MAPP_ASSIGN_OR_RETURN(const std::vector<PointRecord> past, returner.PointsBefore(change));
      for (const PointRecord& point : past) MAPP_RETURN_IF_ERROR(points.Return(point));
      change.applied.reset();
    }
    change.status = ChangeStatus::kProposed;
    MAPP_RETURN_IF_ERROR(writer.PutChange(change).status());
  }
  return decision;
}

}  // namespace mapp
