#pragma once

#include "mapp/base/status.h"
#include "storage/records.h"
#include "storage/sqlite/change_ledger.h"
#include "storage/sqlite/connection.h"

#include <optional>
#include <span>
#include <string>
#include <vector>

namespace mapp::sqlite {

// The keyframe log, map frames and their observations. Promises: storage/map_store.h.

StatusOr<std::optional<FrameId>> FindFrame(Connection& db, SessionId session, uint32_t number);
StatusOr<FrameRecord> GetFrame(Connection& db, FrameId frame);
StatusOr<std::vector<FrameRecord>> ListFrames(Connection& db, MapId map, std::optional<SessionId> session);
StatusOr<std::vector<FrameRecord>> FramesInBox(Connection& db, MapId map, const Aabb& box_map);
StatusOr<std::string> GetPacket(Connection& db, FrameId frame);
StatusOr<std::vector<Observation>> GetObservations(Connection& db, FrameId frame);

StatusOr<FrameId> InsertFrame(Connection& db, ChangeLedger& ledger, const FrameRecord& frame, const std::string& packet,
                              std::span<const Observation> observations);
Status SetFramePose(Connection& db, ChangeLedger& ledger, FrameId frame, bool in_map, const Pose3& T_frame_camera);
Status SetObservations(Connection& db, ChangeLedger& ledger, FrameId frame, std::span<const Observation> observations);

}  // namespace mapp::sqlite
