#pragma once

#include "storage/sqlite/map_reads.h"

#include <optional>
#include <span>
#include <string>
#include <vector>

namespace mapp::sqlite {

/// The MapWriter of one change. Finish it, if the change succeeded, before its savepoint is released.
class Change final : public MapReads<MapWriter> {
 public:
  /// `now_ns`: Unix time for what the store dates itself.
  Change(Connection& db, int64_t now_ns) : MapReads<MapWriter>(db), ledger_(db, now_ns) {}

  Status Finish() { return ledger_.Finish(); }

  // Reads of what the ledger keeps back until asked.
  StatusOr<std::vector<MapRecord>> ListMaps() override;
  StatusOr<MapRecord> FindMap(const std::string& name) override;
  StatusOr<MapRecord> GetMap(MapId map) override;
  StatusOr<std::vector<TileRecord>> ListTiles(MapId map, const std::optional<Aabb>& box_map) override;
  StatusOr<std::vector<SessionDiff>> DiffRevisions(MapId map, Revision from, Revision to) override;

  StatusOr<MapId> CreateMap(const MapRecord& map) override { return sqlite::CreateMap(db_, ledger_, map); }
  Status DeleteMap(MapId map) override { return sqlite::DeleteMap(db_, ledger_, map); }
  Status SetFounder(MapId map, std::optional<SessionId> founder) override {
    return sqlite::SetFounder(db_, ledger_, map, founder);
  }
  Status SetMetricScale(MapId map, bool has_metric_scale) override {
    return sqlite::SetMetricScale(db_, ledger_, map, has_metric_scale);
  }
  Status SkipIds(MapId map, SessionId session, FrameId frame) override {
    return sqlite::SkipIds(db_, map, session, frame);
  }
  StatusOr<CameraId> InsertCamera(const Camera& camera) override { return sqlite::InsertCamera(db_, camera); }
  StatusOr<SessionId> InsertSession(const SessionRecord& session) override {
    return sqlite::InsertSession(db_, ledger_, session);
  }
  Status UpdateSession(const SessionRecord& session) override { return sqlite::UpdateSession(db_, ledger_, session); }
  StatusOr<Revision> NextRevision(MapId map) override { return ledger_.NextRevision(map); }
  Status SetCause(MapId map, RevisionCause cause, std::optional<SessionId> session) override {
    return ledger_.SetCause(map, cause, session);
  }
  Status PutTag(MapId map, const std::string& name, Revision revision) override {
    return sqlite::PutTag(db_, ledger_, map, name, revision);
  }
  Status DeleteTag(MapId map, const std::string& name) override { return sqlite::DeleteTag(db_, map, name); }
  StatusOr<int64_t> DropHistory(MapId map, Revision oldest, int64_t max_rows) override {
    return sqlite::DropHistory(db_, ledger_, map, oldest, max_rows);
  }
  StatusOr<int64_t> GiveBackSpace(int64_t max_bytes) override { return sqlite::GiveBackSpace(db_, max_bytes); }

  StatusOr<FrameId> InsertFrame(const FrameRecord& frame, const std::string& packet,
                                std::span<const Observation> observations) override {
    return sqlite::InsertFrame(db_, ledger_, frame, packet, observations);
  }
  Status SetFramePose(FrameId frame, bool in_map, const Pose3& T_frame_camera) override {
    return sqlite::SetFramePose(db_, ledger_, frame, in_map, T_frame_camera);
  }
  Status SetObservations(FrameId frame, std::span<const Observation> observations) override {
    return sqlite::SetObservations(db_, ledger_, frame, observations);
  }

  StatusOr<MapPointId> InsertPoint(MapId map, const PointRecord& point) override {
    return sqlite::InsertPoint(db_, ledger_, map, point);
  }
  Status UpdatePoint(const PointRecord& point) override { return sqlite::UpdatePoint(db_, ledger_, point); }
  Status TouchPoint(const PointRecord& point) override { return sqlite::TouchPoint(db_, ledger_, point); }
  Status RetirePoint(MapPointId point, std::optional<MapPointId> fused_into) override {
    return sqlite::RetirePoint(db_, ledger_, point, fused_into);
  }
  Status ReturnPoint(const PointRecord& point) override { return sqlite::ReturnPoint(db_, ledger_, point); }
  Status AdoptPoint(MapPointId point, SessionId session, uint64_t session_point,
                    const OrbDescriptor& descriptor) override {
    return sqlite::AdoptPoint(db_, ledger_, point, session, session_point, descriptor);
  }
  Status EraseSession(SessionId session) override { return sqlite::EraseSession(db_, ledger_, session); }
  Status PutTileBlob(MapId map, const TileKey& tile, const TileBlob& blob) override {
    return sqlite::PutTileBlob(db_, ledger_, map, tile, blob);
  }
  Status AppendPlaceBlock(MapId map, const std::string& block) override {
    return sqlite::AppendPlaceBlock(db_, map, block);
  }

  Status AppendEvidence(const EvidenceRecord& evidence) override {
    return sqlite::AppendEvidence(db_, ledger_, evidence);
  }
  Status PutFindings(SessionId session, const std::string& findings) override {
    return sqlite::PutFindings(db_, ledger_, session, findings);
  }
  Status DropFindings(MapId map) override { return sqlite::DropFindings(db_, map); }
  StatusOr<ChangeId> PutChange(const ChangeRecord& change) override { return sqlite::PutChange(db_, ledger_, change); }
  Status DeleteChange(ChangeId change) override { return sqlite::DeleteChange(db_, change); }

 private:
  ChangeLedger ledger_;
};

}  // namespace mapp::sqlite
