#include "storage/sqlite/points.h"

#include "storage/checks.h"
#include "storage/sqlite/blobs.h"
#include "storage/sqlite/rows.h"

namespace mapp::sqlite {
namespace {

/// Where a live point stands before it is changed.
struct PointStanding {
  MapId map;
  std::optional<int64_t> tile_id;
  Revision created;
};

StatusOr<PointStanding> GetPointStanding(Connection& db, ChangeLedger& ledger, MapPointId point) {
  Statement query = db.Prepare("SELECT session_id, tile_id, created_revision FROM points WHERE point_id = ?");
  MAPP_ASSIGN_OR_RETURN(const bool has_row, query.Bind(point).Step());
  if (!has_row) return internal::NoSuchPoint(point);
  PointStanding standing;
  standing.created = query.GetId<Revision>(2);
  if (!query.IsNull(1)) standing.tile_id = query.Int64(1);
  MAPP_ASSIGN_OR_RETURN(standing.map, ledger.MapOfSession(query.GetId<SessionId>(0)));
  return standing;
}

StatusOr<std::optional<int64_t>> TileFor(ChangeLedger& ledger, MapId map, const PointRecord& point) {
  if (!point.in_map) return std::nullopt;
  return ledger.TileAt(map, point.position);
}

/// Copies the live version to the history, ended at `revision`.
Status Archive(Connection& db, MapPointId point, Revision revision, std::optional<MapPointId> fused_into) {
  return db
      .Prepare(
          "INSERT INTO point_history (point_id, created_revision, retired_revision, fused_into, session_id, "
          "session_point, tile_id, x_m, y_m, z_m, view_direction, descriptor, reference_distance_m, num_observations, "
          "confidence, observers) SELECT point_id, created_revision, ?, ?, session_id, session_point, tile_id, x_m, "
          "y_m, z_m, view_direction, descriptor, reference_distance_m, num_observations, confidence, observers "
          "FROM points WHERE point_id = ?")
      .Bind(revision, fused_into, point)
      .Run();
}

Status StoreLive(Connection& db, MapPointId id, std::optional<int64_t> tile_id, Revision revision,
                 const PointRecord& point) {
  const std::string observers = EncodeObservers(point.observers);
  return db
      .Prepare(
          "INSERT INTO points (point_id, session_id, session_point, tile_id, created_revision, x_m, y_m, z_m, "
          "view_direction, descriptor, reference_distance_m, num_observations, confidence, observers) "
          "VALUES (?, ?, ?, ?, ?, ?, ?, ?, ?, ?, ?, ?, ?, ?)")
      .Bind(id, point.session, point.session_point, tile_id, revision, point.position.x(), point.position.y(),
            point.position.z(), Blob{DirectionBytes(point.view_direction)}, Blob{point.descriptor.Bytes()},
            point.reference_distance_m, point.num_observations, point.confidence, Blob{observers})
      .Run();
}

/// Whether the point was retired and stands for itself.
Status CheckReturnable(Connection& db, const PointRecord& point) {
  Statement live = db.Prepare("SELECT 1 FROM points WHERE point_id = ?");
  MAPP_ASSIGN_OR_RETURN(const bool lives, live.Bind(point.id).Step());
  if (lives) return internal::StillLives(point.id);
  // Its number stays when its history has been dropped.
  Statement number =
      db.Prepare("SELECT 1 FROM session_points WHERE session_id = ? AND session_point = ? AND point_id = ?");
  MAPP_ASSIGN_OR_RETURN(const bool is_numbered, number.Bind(point.session, point.session_point, point.id).Step());
  if (!is_numbered) {
    Statement any = db.Prepare("SELECT 1 FROM session_points WHERE point_id = ? LIMIT 1");
    MAPP_ASSIGN_OR_RETURN(const bool ever_lived, any.Bind(point.id).Step());
    return ever_lived ? internal::HasAnotherNumber(point) : internal::NeverLived(point.id);
  }
  Statement last =
      db.Prepare("SELECT fused_into FROM point_history WHERE point_id = ? ORDER BY created_revision DESC LIMIT 1");
  MAPP_ASSIGN_OR_RETURN(const bool has_history, last.Bind(point.id).Step());
  return has_history && !last.IsNull(0) ? internal::IsFused(point.id) : absl::OkStatus();
}

/// The live point that `retired` stands for now.
StatusOr<std::optional<MapPointId>> FollowFusion(Connection& db, MapPointId retired) {
  MapPointId point = retired;
  for (;;) {
    // A point fuses into one that lives, so a chain never meets itself.
    Statement query = db.Prepare(
        "SELECT h.fused_into, EXISTS (SELECT 1 FROM points p WHERE p.point_id = h.fused_into) FROM point_history h "
        "WHERE h.point_id = ? ORDER BY h.created_revision DESC LIMIT 1");
    MAPP_ASSIGN_OR_RETURN(const bool has_row, query.Bind(point).Step());
    if (!has_row || query.IsNull(0)) return std::nullopt;
    point = query.GetId<MapPointId>(0);
    if (query.Int64(1) != 0) return point;
  }
}

StatusOr<std::vector<PointRecord>> ReadPoints(Connection& db, std::span<const MapPointId> points, bool skip_missing) {
  std::vector<PointRecord> records;
  records.reserve(points.size());
  Statement query = db.Prepare("SELECT " MAPP_POINT_COLUMNS " FROM points p WHERE p.point_id = ?");
  for (const MapPointId point : points) {
    MAPP_ASSIGN_OR_RETURN(const bool has_row, query.Reset().Bind(point).Step());
    if (has_row) {
      MAPP_ASSIGN_OR_RETURN(PointRecord record, ReadPoint(query));
      records.push_back(std::move(record));
    } else if (!skip_missing) {
      return internal::NoSuchPoint(point);
    }
  }
  return records;
}

StatusOr<NumberedPoint> ReadNumberedPoint(const Statement& row) {
  return NumberedPoint{static_cast<uint64_t>(row.Int64(0)), row.GetId<MapPointId>(1)};
}

}  // namespace

StatusOr<std::vector<PointRecord>> GetPoints(Connection& db, std::span<const MapPointId> points) {
  return ReadPoints(db, points, /*skip_missing=*/false);
}

StatusOr<std::vector<PointRecord>> FindPoints(Connection& db, std::span<const MapPointId> points) {
  return ReadPoints(db, points, /*skip_missing=*/true);
}

StatusOr<std::vector<std::optional<MapPointId>>> FindSessionPoints(Connection& db, SessionId session,
                                                                   std::span<const uint64_t> session_points) {
  std::vector<std::optional<MapPointId>> found;
  found.reserve(session_points.size());
  Statement query = db.Prepare(
      "SELECT s.point_id, EXISTS (SELECT 1 FROM points p WHERE p.point_id = s.point_id) FROM session_points s "
      "WHERE s.session_id = ? AND s.session_point = ? ORDER BY s.point_id DESC LIMIT 1");
  for (const uint64_t session_point : session_points) {
    MAPP_ASSIGN_OR_RETURN(const bool has_row, query.Reset().Bind(session, session_point).Step());
    if (!has_row) {
      found.push_back(std::nullopt);
    } else if (const auto point = query.GetId<MapPointId>(0); query.Int64(1) != 0) {
      found.push_back(point);
    } else {
      MAPP_ASSIGN_OR_RETURN(const std::optional<MapPointId> successor, FollowFusion(db, point));
      found.push_back(successor);
    }
  }
  return found;
}

StatusOr<std::vector<NumberedPoint>> ListNumberedPoints(Connection& db, SessionId session) {
  Statement query = db.Prepare("SELECT session_point, point_id FROM session_points WHERE session_id = ? ORDER BY 1, 2");
  query.Bind(session);
  return ReadAll(query, ReadNumberedPoint);
}

StatusOr<std::vector<PointRecord>> PointsInTile(Connection& db, MapId map, const TileKey& tile) {
  Statement query =
      db.Prepare("SELECT " MAPP_POINT_COLUMNS
                 " FROM points p WHERE p.tile_id = (SELECT tile_id FROM tiles WHERE map_id = ? AND tile_key = ?)");
  query.Bind(map, tile.Packed());
  return ReadAll(query, ReadPoint);
}

StatusOr<std::vector<PointRecord>> PointsOfSession(Connection& db, SessionId session) {
  Statement query =
      db.Prepare("SELECT " MAPP_POINT_COLUMNS
                 " FROM session_points s JOIN points p ON p.point_id = s.point_id WHERE s.session_id = ?");
  query.Bind(session);
  return ReadAll(query, ReadPoint);
}

StatusOr<MapPointId> InsertPoint(Connection& db, ChangeLedger& ledger, MapId map, const PointRecord& point) {
  MAPP_RETURN_IF_ERROR(internal::CheckPoint(point));
  MAPP_ASSIGN_OR_RETURN(const MapId map_of_session, ledger.MapOfSession(point.session));
  MAPP_RETURN_IF_ERROR(internal::CheckPointsMap(point, map_of_session, map));
  MAPP_ASSIGN_OR_RETURN(const std::optional<int64_t> tile_id, TileFor(ledger, map, point));
  MAPP_ASSIGN_OR_RETURN(const Revision revision, ledger.NextRevision(map));
  MAPP_ASSIGN_OR_RETURN(const MapPointId id, ledger.NewPointId());
  MAPP_RETURN_IF_ERROR(StoreLive(db, id, tile_id, revision, point));
  MAPP_RETURN_IF_ERROR(db.Prepare("INSERT INTO session_points (session_id, session_point, point_id) VALUES (?, ?, ?)")
                           .Bind(point.session, point.session_point, id)
                           .Run());
  if (tile_id) MAPP_RETURN_IF_ERROR(ledger.ChangeTile(map, *tile_id, 1));
  return id;
}

Status UpdatePoint(Connection& db, ChangeLedger& ledger, const PointRecord& point) {
  MAPP_RETURN_IF_ERROR(internal::CheckPoint(point));
  MAPP_ASSIGN_OR_RETURN(const PointStanding old, GetPointStanding(db, ledger, point.id));
  MAPP_ASSIGN_OR_RETURN(const std::optional<int64_t> tile_id, TileFor(ledger, old.map, point));
  MAPP_ASSIGN_OR_RETURN(const Revision revision, ledger.NextRevision(old.map));
  // A version that begins and ends in one revision could never be read: it leaves no history.
  if (old.created != revision) MAPP_RETURN_IF_ERROR(Archive(db, point.id, revision, std::nullopt));
  MAPP_RETURN_IF_ERROR(db.Prepare("UPDATE points SET created_revision = ?, tile_id = ?, x_m = ?, y_m = ?, z_m = ?, "
                                  "view_direction = ?, descriptor = ? WHERE point_id = ?")
                           .Bind(revision, tile_id, point.position.x(), point.position.y(), point.position.z(),
                                 Blob{DirectionBytes(point.view_direction)}, Blob{point.descriptor.Bytes()}, point.id)
                           .Run());
  if (old.tile_id) MAPP_RETURN_IF_ERROR(ledger.ChangeTile(old.map, *old.tile_id, -1));
  if (tile_id) MAPP_RETURN_IF_ERROR(ledger.ChangeTile(old.map, *tile_id, 1));
  return absl::OkStatus();
}

Status TouchPoint(Connection& db, ChangeLedger& ledger, const PointRecord& point) {
  MAPP_RETURN_IF_ERROR(internal::CheckPoint(point));
  MAPP_ASSIGN_OR_RETURN(const MapId map, ledger.MapOfSession(point.session));
  MAPP_ASSIGN_OR_RETURN(const std::optional<int64_t> tile_id, TileFor(ledger, map, point));
  const std::string observers = EncodeObservers(point.observers);
  MAPP_RETURN_IF_ERROR(
      db.Prepare("UPDATE points SET view_direction = ?, descriptor = ?, reference_distance_m = ?, num_observations = "
                 "?, confidence = ?, observers = ? WHERE point_id = ?")
          .Bind(Blob{DirectionBytes(point.view_direction)}, Blob{point.descriptor.Bytes()}, point.reference_distance_m,
                point.num_observations, point.confidence, Blob{observers}, point.id)
          .Run());
  if (db.num_changed() == 0) return internal::NoSuchPoint(point.id);
  return tile_id ? ledger.ChangeTile(map, *tile_id, 0) : absl::OkStatus();
}

Status RetirePoint(Connection& db, ChangeLedger& ledger, MapPointId point, std::optional<MapPointId> fused_into) {
  MAPP_ASSIGN_OR_RETURN(const PointStanding old, GetPointStanding(db, ledger, point));
  MAPP_RETURN_IF_ERROR(internal::CheckFusesIntoAnother(point, fused_into));
  if (fused_into) {
    MAPP_ASSIGN_OR_RETURN(const PointStanding successor, GetPointStanding(db, ledger, *fused_into));
    MAPP_RETURN_IF_ERROR(internal::CheckFusion(old.map, successor.map));
  }
  MAPP_ASSIGN_OR_RETURN(const Revision revision, ledger.NextRevision(old.map));
  MAPP_RETURN_IF_ERROR(Archive(db, point, revision, fused_into));
  MAPP_RETURN_IF_ERROR(db.Prepare("DELETE FROM points WHERE point_id = ?").Bind(point).Run());
  if (old.tile_id) MAPP_RETURN_IF_ERROR(ledger.ChangeTile(old.map, *old.tile_id, -1));
  return absl::OkStatus();
}

Status ReturnPoint(Connection& db, ChangeLedger& ledger, const PointRecord& point) {
  MAPP_RETURN_IF_ERROR(internal::CheckPoint(point));
  MAPP_ASSIGN_OR_RETURN(const MapId map, ledger.MapOfSession(point.session));
  MAPP_RETURN_IF_ERROR(CheckReturnable(db, point));
  MAPP_ASSIGN_OR_RETURN(const std::optional<int64_t> tile_id, TileFor(ledger, map, point));
  MAPP_ASSIGN_OR_RETURN(const Revision revision, ledger.NextRevision(map));
  // A version that was made and retired at this very revision was never read, and would be in the way of the new one
  // when that becomes history.
  MAPP_RETURN_IF_ERROR(db.Prepare("DELETE FROM point_history WHERE point_id = ? AND created_revision = ?")
                           .Bind(point.id, revision)
                           .Run());
  MAPP_RETURN_IF_ERROR(StoreLive(db, point.id, tile_id, revision, point));
  return tile_id ? ledger.ChangeTile(map, *tile_id, 1) : absl::OkStatus();
}

}  // namespace mapp::sqlite
