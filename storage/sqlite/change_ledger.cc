#include "storage/sqlite/change_ledger.h"

#include "storage/checks.h"

#include <algorithm>
#include <utility>

namespace mapp::sqlite {
namespace {

/// Stands for the revision that ends an archived version until the end of the change. Greater than any.
constexpr int64_t kOpenEnd = INT64_MAX;

}  // namespace

StatusOr<ChangeLedger::MapEntry*> ChangeLedger::Entry(MapId map) {
  if (const auto found = maps_.find(map); found != maps_.end()) return &found->second;
  Statement query = db_.Prepare("SELECT revision, tile_edge_m FROM maps WHERE map_id = ?");
  MAPP_ASSIGN_OR_RETURN(const bool has_row, query.Bind(map).Step());
  if (!has_row) return internal::NoSuchMap(map);
  MapEntry& entry = maps_[map];
  entry.base = query.GetId<Revision>(0);
  entry.tile_edge_m = query.Double(1);
  return &entry;
}

StatusOr<Revision> ChangeLedger::NextRevision(MapId map) {
  MAPP_ASSIGN_OR_RETURN(MapEntry * entry, Entry(map));
  entry->next_taken = true;
  return Revision(entry->base.value() + 1);
}

StatusOr<MapId> ChangeLedger::MapOfSession(SessionId session) {
  if (const auto found = sessions_.find(session); found != sessions_.end()) return found->second;
  Statement query = db_.Prepare("SELECT map_id FROM sessions WHERE session_id = ?");
  MAPP_ASSIGN_OR_RETURN(const bool has_row, query.Bind(session).Step());
  if (!has_row) return internal::NoSuchSession(session);
  return sessions_[session] = query.GetId<MapId>(0);
}

StatusOr<MapPointId> ChangeLedger::NewPointId() {
  if (!next_point_id_) {
    MAPP_ASSIGN_OR_RETURN(next_point_id_, db_.QueryInt64("SELECT next_id FROM id_sequences WHERE name = 'point'"));
  }
  point_ids_used_ = true;
  return MapPointId(static_cast<uint64_t>((*next_point_id_)++));
}

Status ChangeLedger::AddFrames(MapId map, int64_t count) {
  MAPP_ASSIGN_OR_RETURN(MapEntry * entry, Entry(map));
  entry->frames += count;
  return absl::OkStatus();
}

Status ChangeLedger::AddSessions(MapId map, int64_t count) {
  MAPP_ASSIGN_OR_RETURN(MapEntry * entry, Entry(map));
  entry->sessions += count;
  return absl::OkStatus();
}

Status ChangeLedger::AttributeTo(MapId map, SessionId session) {
  MAPP_ASSIGN_OR_RETURN(MapEntry * entry, Entry(map));
  if (entry->cause != RevisionCause::kUnknown) return absl::OkStatus();
  entry->cause = RevisionCause::kKeyframe;
  entry->session = session;
  return absl::OkStatus();
}

Status ChangeLedger::SetCause(MapId map, RevisionCause cause, std::optional<SessionId> session) {
  MAPP_RETURN_IF_ERROR(internal::CheckCause(cause));
  MAPP_ASSIGN_OR_RETURN(MapEntry * entry, Entry(map));
  entry->cause = cause;
  entry->session = session;
  return absl::OkStatus();
}

Status ChangeLedger::OpenSession(MapId map, SessionId session) {
  MAPP_RETURN_IF_ERROR(Entry(map).status());
  sessions_[session] = map;
  revised_sessions_[session] = true;
  return absl::OkStatus();
}

Status ChangeLedger::ReviseSession(SessionId session) {
  MAPP_ASSIGN_OR_RETURN(const MapId map, MapOfSession(session));
  MAPP_RETURN_IF_ERROR(Entry(map).status());
  if (!revised_sessions_.emplace(session, false).second) return absl::OkStatus();
  return db_
      .Prepare(
          "INSERT INTO session_history (session_id, created_revision, retired_revision, closed_ns, "
          "aligned_at_keyframe, optimized_revision, tx_m, ty_m, tz_m, qw, qx, qy, qz, scale_map_session, "
          "quarantined_ns, quarantine_reason, quarantine_released_ns) SELECT session_id, state_revision, ?, closed_ns, "
          "aligned_at_keyframe, optimized_revision, tx_m, ty_m, tz_m, qw, qx, qy, qz, scale_map_session, "
          "quarantined_ns, quarantine_reason, quarantine_released_ns FROM sessions WHERE session_id = ?")
      .Bind(kOpenEnd, session)
      .Run();
}

Status ChangeLedger::ReviseMap(MapId map) {
  MAPP_ASSIGN_OR_RETURN(MapEntry * entry, Entry(map));
  if (std::exchange(entry->revised, true)) return absl::OkStatus();
  return db_
      .Prepare(
          "INSERT INTO map_history (map_id, created_revision, retired_revision, founder_session_id, has_metric_scale) "
          "SELECT map_id, state_revision, ?, founder_session_id, has_metric_scale FROM maps WHERE map_id = ?")
      .Bind(kOpenEnd, map)
      .Run();
}

StatusOr<int64_t> ChangeLedger::TileAt(MapId map, const Eigen::Vector3d& p_map) {
  MAPP_ASSIGN_OR_RETURN(const MapEntry* entry, Entry(map));
  MAPP_ASSIGN_OR_RETURN(const TileKey key, internal::TileAt(entry->tile_edge_m, p_map));
  return TileOf(map, key);
}

StatusOr<int64_t> ChangeLedger::TileOf(MapId map, const TileKey& key) {
  const std::pair<MapId, TileKey> known(map, key);
  if (const auto found = tile_ids_.find(known); found != tile_ids_.end()) return found->second;
  Statement query = db_.Prepare("SELECT tile_id FROM tiles WHERE map_id = ? AND tile_key = ?");
  MAPP_ASSIGN_OR_RETURN(const bool has_row, query.Bind(map, key.Packed()).Step());
  int64_t tile_id = 0;
  if (has_row) {
    tile_id = query.Int64(0);
  } else {
    MAPP_ASSIGN_OR_RETURN(const MapEntry* entry, Entry(map));
    MAPP_ASSIGN_OR_RETURN(tile_id, InsertTile(map, key, entry->tile_edge_m));
  }
  return tile_ids_[known] = tile_id;
}

StatusOr<int64_t> ChangeLedger::InsertTile(MapId map, const TileKey& key, double tile_edge_m) {
  MAPP_RETURN_IF_ERROR(db_.Prepare("INSERT INTO tiles (map_id, tile_key, revision, num_points) VALUES (?, ?, 0, 0)")
                           .Bind(map, key.Packed())
                           .Run());
  const int64_t tile_id = db_.last_insert_id();
  const Aabb box = TileGrid{tile_edge_m}.BoxOf(key);
  MAPP_RETURN_IF_ERROR(db_.Prepare("INSERT INTO tile_index VALUES (?, ?, ?, ?, ?, ?, ?, ?, ?)")
                           .Bind(tile_id, map, map, box.min().x(), box.max().x(), box.min().y(), box.max().y(),
                                 box.min().z(), box.max().z())
                           .Run());
  return tile_id;
}

Status ChangeLedger::ChangeTile(MapId map, int64_t tile_id, int64_t num_points) {
  MAPP_RETURN_IF_ERROR(NextRevision(map).status());
  TileEntry& tile = tiles_[tile_id];
  tile.map = map;
  tile.changed = true;
  tile.points += num_points;
  maps_[map].points += num_points;
  return absl::OkStatus();
}

void ChangeLedger::Forget(MapId map) {
  maps_.erase(map);
  std::erase_if(revised_sessions_, [this, map](const auto& entry) { return sessions_[entry.first] == map; });
  std::erase_if(sessions_, [map](const auto& entry) { return entry.second == map; });
  std::erase_if(tile_ids_, [map](const auto& entry) { return entry.first.first == map; });
  std::erase_if(tiles_, [map](const auto& entry) { return entry.second.map == map; });
}

void ChangeLedger::Forget(SessionId session) {
  revised_sessions_.erase(session);
  sessions_.erase(session);
  for (auto& [map, entry] : maps_) {
    if (entry.session == session) entry.session.reset();
  }
}

Status ChangeLedger::FlushTiles() {
  for (auto& [tile_id, tile] : tiles_) {
    if (!tile.changed) continue;
    MAPP_ASSIGN_OR_RETURN(const Revision revision, NextRevision(tile.map));
    MAPP_RETURN_IF_ERROR(db_.Prepare("UPDATE tiles SET revision = ?, num_points = num_points + ? WHERE tile_id = ?")
                             .Bind(revision, std::exchange(tile.points, 0), tile_id)
                             .Run());
    tile.changed = false;
  }
  return absl::OkStatus();
}

Status ChangeLedger::FlushMaps() {
  for (auto& [map, entry] : maps_) {
    MAPP_RETURN_IF_ERROR(
        db_.Prepare("UPDATE maps SET revision = ?, num_frames = num_frames + ?, num_points = num_points + ?, "
                    "num_sessions = num_sessions + ? WHERE map_id = ?")
            .Bind(entry.After(), std::exchange(entry.frames, 0), std::exchange(entry.points, 0),
                  std::exchange(entry.sessions, 0), map)
            .Run());
  }
  return absl::OkStatus();
}

Status ChangeLedger::Flush() {
  MAPP_RETURN_IF_ERROR(FlushTiles());
  MAPP_RETURN_IF_ERROR(FlushMaps());
  if (!std::exchange(point_ids_used_, false)) return absl::OkStatus();
  return db_.Prepare("UPDATE id_sequences SET next_id = ? WHERE name = 'point'").Bind(*next_point_id_).Run();
}

Status ChangeLedger::FinishVersions() {
  // A version that begins and ends in one revision could never be read: it leaves no history.
  for (const auto& [session, is_new] : revised_sessions_) {
    const Revision revision = maps_.at(sessions_.at(session)).After();
    MAPP_RETURN_IF_ERROR(db_.Prepare("DELETE FROM session_history WHERE session_id = ? AND created_revision = ? AND "
                                     "retired_revision = ?")
                             .Bind(session, revision, kOpenEnd)
                             .Run());
    MAPP_RETURN_IF_ERROR(
        db_.Prepare("UPDATE session_history SET retired_revision = ? WHERE session_id = ? AND retired_revision = ?")
            .Bind(revision, session, kOpenEnd)
            .Run());
    MAPP_RETURN_IF_ERROR(
        db_.Prepare("UPDATE sessions SET state_revision = ?1, opened_revision = iif(?2, ?1, opened_revision) WHERE "
                    "session_id = ?3")
            .Bind(revision, is_new, session)
            .Run());
  }
  for (const auto& [map, entry] : maps_) {
    if (!entry.revised) continue;
    MAPP_RETURN_IF_ERROR(
        db_.Prepare("DELETE FROM map_history WHERE map_id = ? AND created_revision = ? AND retired_revision = ?")
            .Bind(map, entry.After(), kOpenEnd)
            .Run());
    MAPP_RETURN_IF_ERROR(
        db_.Prepare("UPDATE map_history SET retired_revision = ? WHERE map_id = ? AND retired_revision = ?")
            .Bind(entry.After(), map, kOpenEnd)
            .Run());
    MAPP_RETURN_IF_ERROR(
        db_.Prepare("UPDATE maps SET state_revision = ? WHERE map_id = ?").Bind(entry.After(), map).Run());
  }
  return absl::OkStatus();
}

Status ChangeLedger::Finish() {
  MAPP_RETURN_IF_ERROR(Flush());
  MAPP_RETURN_IF_ERROR(FinishVersions());
  for (const auto& [map, entry] : maps_) {
    if (!entry.next_taken) continue;
    MAPP_RETURN_IF_ERROR(
        db_.Prepare("INSERT INTO revisions (map_id, revision, committed_ns, cause, session_id) VALUES (?, ?, ?, ?, ?)")
            .Bind(map, entry.After(), now_ns_, static_cast<int>(entry.cause), entry.session)
            .Run());
  }
  return absl::OkStatus();
}

}  // namespace mapp::sqlite
