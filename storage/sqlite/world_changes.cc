#include "storage/sqlite/world_changes.h"

#include "storage/checks.h"
#include "storage/sqlite/blobs.h"
#include "storage/sqlite/catalog.h"
#include "storage/sqlite/rows.h"

#include <algorithm>

namespace mapp::sqlite {
namespace {

void BindBox(Statement& statement, const std::optional<OrientedBox>& box) {
  if (!box) {
    for (int i = 0; i < kBoxColumns; ++i) statement.Bind(std::optional<double>());
    return;
  }
  BindPose(statement, box->T_frame_box);
  statement.Bind(box->size_m.x(), box->size_m.y(), box->size_m.z());
}

/// Under the record's id, or a new one when that is the default.
Status Store(Connection& db, const ChangeRecord& change) {
  const std::string sessions = EncodeAscendingIds(change.sessions);
  const std::string points_before = EncodeAscendingIds(change.points_before);
  const std::string points_after = EncodeAscendingIds(change.points_after);
  Statement put =
      db.Prepare("INSERT OR REPLACE INTO changes (" MAPP_CHANGE_COLUMNS
                 ") VALUES (?, ?, ?, ?, ?, ?, ?, ?, ?, ?, ?, ?, ?, ?, ?, ?, ?, ?, ?, ?, ?, ?, ?, ?, ?, ?, ?, "
                 "?, ?, ?, ?, ?, ?, ?)");
  put.Bind(change.id == ChangeId() ? std::nullopt : std::optional(change.id), change.map, static_cast<int>(change.kind),
           static_cast<int>(change.status), change.confidence, change.after_ns, change.before_ns, change.first_seen_ns,
           change.last_seen_ns, change.detected, change.applied, Blob{sessions}, Blob{points_before},
           Blob{points_after});
  BindBox(put, change.box_before);
  BindBox(put, change.box_after);
  return put.Run();
}

}  // namespace

StatusOr<std::vector<ChangeRecord>> ListChanges(Connection& db, MapId map) {
  MAPP_RETURN_IF_ERROR(GetMap(db, map).status());
  Statement query = db.Prepare("SELECT " MAPP_CHANGE_COLUMNS " FROM changes WHERE map_id = ? ORDER BY change_id");
  query.Bind(map);
  return ReadAll(query, ReadChange);
}

StatusOr<ChangeRecord> GetChange(Connection& db, ChangeId change) {
  Statement query = db.Prepare("SELECT " MAPP_CHANGE_COLUMNS " FROM changes WHERE change_id = ?");
  MAPP_ASSIGN_OR_RETURN(const bool has_row, query.Bind(change).Step());
  if (!has_row) return internal::NoSuchChange(change);
  return ReadChange(query);
}

StatusOr<ChangeId> PutChange(Connection& db, ChangeLedger& ledger, const ChangeRecord& change) {
  MAPP_RETURN_IF_ERROR(internal::CheckChange(change));
  MAPP_RETURN_IF_ERROR(GetMap(db, change.map).status());
  for (const SessionId session : change.sessions) {
    MAPP_ASSIGN_OR_RETURN(const MapId map, ledger.MapOfSession(session));
    MAPP_RETURN_IF_ERROR(internal::CheckChangesSession(change, session, map));
  }
  if (change.id == ChangeId()) {
    MAPP_RETURN_IF_ERROR(Store(db, change));
    return ChangeId(static_cast<uint64_t>(db.last_insert_id()));
  }
  Statement stored = db.Prepare("SELECT map_id FROM changes WHERE change_id = ?");
  MAPP_ASSIGN_OR_RETURN(const bool has_row, stored.Bind(change.id).Step());
  if (!has_row) return internal::NoSuchChange(change.id);
  MAPP_RETURN_IF_ERROR(internal::CheckChangesMap(change, stored.GetId<MapId>(0)));
  MAPP_RETURN_IF_ERROR(Store(db, change));
  return change.id;
}

Status DeleteChange(Connection& db, ChangeId change) {
  MAPP_RETURN_IF_ERROR(db.Prepare("DELETE FROM changes WHERE change_id = ?").Bind(change).Run());
  return db.num_changed() > 0 ? absl::OkStatus() : internal::NoSuchChange(change);
}

Status EraseFromChanges(Connection& db, MapId map, SessionId session) {
  MAPP_ASSIGN_OR_RETURN(std::vector<ChangeRecord> changes, ListChanges(db, map));
  for (ChangeRecord& change : changes) {
    if (!std::ranges::binary_search(change.sessions, session)) continue;
    std::erase(change.sessions, session);
    if (change.sessions.empty()) {
      MAPP_RETURN_IF_ERROR(DeleteChange(db, change.id));
    } else {
      MAPP_RETURN_IF_ERROR(Store(db, change));
    }
  }
  return absl::OkStatus();
}

}  // namespace mapp::sqlite
