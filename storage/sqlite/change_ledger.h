#pragma once

#include "mapp/base/id.h"
#include "mapp/base/status.h"
#include "mapp/map/tile.h"
#include "storage/records.h"
#include "storage/sqlite/connection.h"

#include <cstdint>
#include <map>
#include <optional>
#include <unordered_map>

namespace mapp::sqlite {

/// What one change owes to the revisions and counters of maps and tiles. A keyframe's upload touches a few tiles a
/// thousand times; the ledger adds that up in memory and writes each row once. Dropped with a change that fails.
class ChangeLedger {
 public:
  /// `now_ns`: Unix time the change's revisions are dated with.
  ChangeLedger(Connection& db, int64_t now_ns) : db_(db), now_ns_(now_ns) {}

  int64_t now_ns() const { return now_ns_; }

  /// The revision this change makes of `map`. NOT_FOUND without such a map.
  StatusOr<Revision> NextRevision(MapId map);
  /// NOT_FOUND without such a session.
  StatusOr<MapId> MapOfSession(SessionId session);
  StatusOr<MapPointId> NewPointId();

  Status AddFrames(MapId map, int64_t count);
  Status AddSessions(MapId map, int64_t count);
  /// Notes in the map's next revision that `session` has brought a keyframe, unless a cause is set.
  Status AttributeTo(MapId map, SessionId session);
  Status SetCause(MapId map, RevisionCause cause, std::optional<SessionId> session);

  /// The session has just been inserted.
  Status OpenSession(MapId map, SessionId session);
  /// The session's row, or the map's founder or scale, is about to be changed: what it was becomes history, up to the
  /// map's revision after this change.
  Status ReviseSession(SessionId session);
  Status ReviseMap(MapId map);

  /// Row of the tile that holds `p_map`, made when there is none. INVALID_ARGUMENT outside of the tiling.
  StatusOr<int64_t> TileAt(MapId map, const Eigen::Vector3d& p_map);
  StatusOr<int64_t> TileOf(MapId map, const TileKey& key);
  /// The tile's content has changed; its number of points by `num_points`.
  Status ChangeTile(MapId map, int64_t tile_id, int64_t num_points);

  /// Forgets what it owes to a map that has been deleted.
  void Forget(MapId map);
  void Forget(SessionId session);
  /// Writes what has come together so far, so that reads see it.
  Status Flush();
  /// Flushes and enters the revisions. Once, at the end of the change.
  Status Finish();

 private:
  struct MapEntry {
    Revision base;
    double tile_edge_m = 0;
    bool next_taken = false;  ///< the change makes a revision
    int64_t frames = 0, points = 0, sessions = 0;
    RevisionCause cause = RevisionCause::kUnknown;
    std::optional<SessionId> session;
    bool revised = false;
    Revision After() const { return Revision(base.value() + (next_taken ? 1 : 0)); }
  };
  struct TileEntry {
    MapId map;
    bool changed = false;
    int64_t points = 0;
  };

  StatusOr<MapEntry*> Entry(MapId map);
  StatusOr<int64_t> InsertTile(MapId map, const TileKey& key, double tile_edge_m);
  Status FlushTiles();
  Status FlushMaps();
  /// Ends the versions that were archived, with the revision that is certain only now.
  Status FinishVersions();

  Connection& db_;
  int64_t now_ns_;
  std::unordered_map<MapId, MapEntry> maps_;
  std::unordered_map<SessionId, MapId> sessions_;
  std::map<SessionId, bool> revised_sessions_;  ///< true: opened by this change
  std::map<std::pair<MapId, TileKey>, int64_t> tile_ids_;
  std::unordered_map<int64_t, TileEntry> tiles_;  ///< by tile_id
  std::optional<int64_t> next_point_id_;
  bool point_ids_used_ = false;
};

}  // namespace mapp::sqlite
