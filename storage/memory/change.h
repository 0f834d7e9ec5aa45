#pragma once

#include "storage/memory/reads.h"

#include <cstdint>
#include <map>
#include <memory>
#include <optional>
#include <set>
#include <span>
#include <string>

namespace mapp::memory {

/// The MapWriter of one change, on a copy of what was there before: dropped, it leaves nothing behind.
class Change final : public Reads<MapWriter> {
 public:
  /// `now_ns`: Unix time for what the store dates itself.
  Change(Contents before, int64_t now_ns) : Reads(std::move(before)), now_ns_(now_ns) {}

  /// What is there after the change. Once, when the change has succeeded.
  Contents Finish();

  StatusOr<MapId> CreateMap(const MapRecord& map) override;
  Status DeleteMap(MapId map) override;
  Status SetFounder(MapId map, std::optional<SessionId> founder) override;
  Status SetMetricScale(MapId map, bool has_metric_scale) override;
  Status SkipIds(MapId map, SessionId session, FrameId frame) override;
  StatusOr<CameraId> InsertCamera(const Camera& camera) override;
  StatusOr<SessionId> InsertSession(const SessionRecord& session) override;
  Status UpdateSession(const SessionRecord& session) override;

  StatusOr<Revision> NextRevision(MapId map) override;
  Status SetCause(MapId map, RevisionCause cause, std::optional<SessionId> session) override;
  Status PutTag(MapId map, const std::string& name, Revision revision) override;
  Status DeleteTag(MapId map, const std::string& name) override;
  StatusOr<int64_t> DropHistory(MapId map, Revision oldest, int64_t max_rows) override;
  /// Memory goes back by itself.
  StatusOr<int64_t> GiveBackSpace(int64_t) override { return 0; }

  StatusOr<FrameId> InsertFrame(const FrameRecord& frame, const std::string& packet,
                                std::span<const Observation> observations) override;
  Status SetFramePose(FrameId frame, bool in_map, const Pose3& T_frame_camera) override;
  Status SetObservations(FrameId frame, std::span<const Observation> observations) override;

  StatusOr<MapPointId> InsertPoint(MapId map, const PointRecord& point) override;
  Status UpdatePoint(const PointRecord& point) override;
  Status TouchPoint(const PointRecord& point) override;
  Status RetirePoint(MapPointId point, std::optional<MapPointId> fused_into) override;
  Status ReturnPoint(const PointRecord& point) override;
  Status AdoptPoint(MapPointId point, SessionId session, uint64_t session_point,
                    const OrbDescriptor& descriptor) override;
  Status EraseSession(SessionId session) override;
  Status PutTileBlob(MapId map, const TileKey& tile, const TileBlob& blob) override;
  Status AppendPlaceBlock(MapId map, const std::string& block) override;

  Status AppendEvidence(const EvidenceRecord& evidence) override;
  Status PutFindings(SessionId session, const std::string& findings) override;
  Status DropFindings(MapId map) override;
  StatusOr<ChangeId> PutChange(const ChangeRecord& change) override;
  Status DeleteChange(ChangeId change) override;

 private:
  /// A map that this change changes. The contents hold the same state: reads see what is written.
  struct Draft {
    std::shared_ptr<MapState> state;
    bool has_revision = false;  ///< the change makes one
    RevisionCause cause = RevisionCause::kUnknown;
    std::optional<SessionId> session;
  };

  void EraseCamerasIfUnused(std::set<CameraId> cameras);
  /// For a map that exists. References stay.
  Draft& Edit(MapId map);
  /// The same, with a revision of this change.
  MapState& Revise(MapId map);
  /// Of a revised map: the content of the tile has changed, its number of points by `num_points`.
  static void ChangeTile(MapState& map, const TileKey& key, int64_t num_points);
  /// A live point comes to its tile or leaves it, when it is in the map.
  static void EnterTile(MapState& map, const PointRecord& point);
  static void LeaveTile(MapState& map, const PointRecord& point);

  const int64_t now_ns_;
  std::map<MapId, Draft> drafts_;
};

}  // namespace mapp::memory
