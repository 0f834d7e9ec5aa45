#pragma once

#include "mapp/base/status.h"
#include "storage/records.h"
#include "storage/sqlite/change_ledger.h"
#include "storage/sqlite/connection.h"

#include <optional>
#include <string>
#include <vector>

namespace mapp::sqlite {

// Maps, sessions and cameras. What the functions promise stands with those of the same name in storage/map_store.h.

StatusOr<std::vector<MapRecord>> ListMaps(Connection& db);
StatusOr<MapRecord> FindMap(Connection& db, const std::string& name);
StatusOr<MapRecord> GetMap(Connection& db, MapId map);
StatusOr<std::vector<SessionRecord>> ListSessions(Connection& db, std::optional<MapId> map);
StatusOr<SessionRecord> GetSession(Connection& db, SessionId session);
StatusOr<CameraRecord> GetCamera(Connection& db, CameraId camera);

StatusOr<MapId> CreateMap(Connection& db, ChangeLedger& ledger, const MapRecord& map);
Status DeleteMap(Connection& db, ChangeLedger& ledger, MapId map);
Status SetFounder(Connection& db, ChangeLedger& ledger, MapId map, std::optional<SessionId> founder);
Status SetMetricScale(Connection& db, ChangeLedger& ledger, MapId map, bool has_metric_scale);
Status SkipIds(Connection& db, MapId map, SessionId session, FrameId frame);
Status DeleteCameraIfUnused(Connection& db, CameraId camera);
StatusOr<CameraId> InsertCamera(Connection& db, const Camera& camera);
StatusOr<SessionId> InsertSession(Connection& db, ChangeLedger& ledger, const SessionRecord& session);
Status UpdateSession(Connection& db, ChangeLedger& ledger, const SessionRecord& session);

}  // namespace mapp::sqlite
