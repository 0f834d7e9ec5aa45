#pragma once

#include "mapp/base/status.h"
#include "storage/records.h"
#include "storage/sqlite/change_ledger.h"
#include "storage/sqlite/connection.h"

#include <optional>
#include <span>
#include <vector>

namespace mapp::sqlite {

// Map points, their history and the devices' numbers for them. Promises: storage/map_store.h.

StatusOr<std::vector<PointRecord>> GetPoints(Connection& db, std::span<const MapPointId> points);
StatusOr<std::vector<PointRecord>> FindPoints(Connection& db, std::span<const MapPointId> points);
StatusOr<std::vector<std::optional<MapPointId>>> FindSessionPoints(Connection& db, SessionId session,
                                                                   std::span<const uint64_t> session_points);
StatusOr<std::vector<NumberedPoint>> ListNumberedPoints(Connection& db, SessionId session);
StatusOr<std::vector<PointRecord>> PointsInTile(Connection& db, MapId map, const TileKey& tile);
StatusOr<std::vector<PointRecord>> PointsOfSession(Connection& db, SessionId session);

StatusOr<MapPointId> InsertPoint(Connection& db, ChangeLedger& ledger, MapId map, const PointRecord& point);
Status UpdatePoint(Connection& db, ChangeLedger& ledger, const PointRecord& point);
Status TouchPoint(Connection& db, ChangeLedger& ledger, const PointRecord& point);
Status RetirePoint(Connection& db, ChangeLedger& ledger, MapPointId point, std::optional<MapPointId> fused_into);
Status ReturnPoint(Connection& db, ChangeLedger& ledger, const PointRecord& point);

}  // namespace mapp::sqlite
