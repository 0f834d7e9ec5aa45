#pragma once

#include "storage/map_store.h"
#include "storage/memory/contents.h"

#include <optional>
#include <span>
#include <string>
#include <vector>

namespace mapp::memory {

/// The reading half of `Interface`: MapReader, or MapWriter, which reads too.
template <typename Interface>
class Reads : public Interface {
 public:
  StatusOr<std::vector<MapRecord>> ListMaps() override;
  StatusOr<MapRecord> FindMap(const std::string& name) override;
  StatusOr<MapRecord> GetMap(MapId map) override;
  StatusOr<std::vector<SessionRecord>> ListSessions(std::optional<MapId> map) override;
  StatusOr<SessionRecord> GetSession(SessionId session) override;
  StatusOr<CameraRecord> GetCamera(CameraId camera) override;

  StatusOr<std::optional<FrameId>> FindFrame(SessionId session, uint32_t number) override;
  StatusOr<FrameRecord> GetFrame(FrameId frame) override;
  StatusOr<std::vector<FrameRecord>> ListFrames(MapId map, std::optional<SessionId> session) override;
  StatusOr<std::vector<FrameRecord>> FramesInBox(MapId map, const Aabb& box_map) override;
  StatusOr<std::string> GetPacket(FrameId frame) override;
  StatusOr<std::vector<Observation>> GetObservations(FrameId frame) override;

  StatusOr<std::vector<PointRecord>> GetPoints(std::span<const MapPointId> points) override;
  StatusOr<std::vector<PointRecord>> FindPoints(std::span<const MapPointId> points) override;
  StatusOr<std::vector<std::optional<MapPointId>>> FindSessionPoints(SessionId session,
                                                                     std::span<const uint64_t> session_points) override;
  StatusOr<std::vector<NumberedPoint>> ListNumberedPoints(SessionId session) override;
  StatusOr<std::vector<PointRecord>> PointsInTile(MapId map, const TileKey& tile) override;
  StatusOr<std::vector<PointRecord>> PointsOfSession(SessionId session) override;
  StatusOr<std::vector<TileRecord>> ListTiles(MapId map, const std::optional<Aabb>& box_map) override;
  StatusOr<std::optional<TileBlob>> GetTileBlob(MapId map, const TileKey& tile) override;
  StatusOr<std::vector<std::string>> ListPlaceBlocks(MapId map) override;

  StatusOr<std::vector<EvidenceRecord>> ListEvidence(SessionId session) override;
  StatusOr<bool> HasEvidence(SessionId session, uint32_t number) override;
  StatusOr<std::optional<std::string>> FindFindings(SessionId session) override;
  StatusOr<std::vector<ChangeRecord>> ListChanges(MapId map) override;
  StatusOr<ChangeRecord> GetChange(ChangeId change) override;

  StatusOr<std::vector<RevisionRecord>> ListRevisions(MapId map, Revision first, Revision last) override;
  StatusOr<std::vector<TagRecord>> ListTags(MapId map) override;
  StatusOr<std::vector<SessionDiff>> DiffRevisions(MapId map, Revision from, Revision to) override;
  StatusOr<int64_t> CountHistory(MapId map, Revision oldest) override;

 protected:
  explicit Reads(Contents contents) : contents_(std::move(contents)) {}

  Contents contents_;
};

extern template class Reads<MapReader>;
extern template class Reads<MapWriter>;

class Reader final : public Reads<MapReader> {
 public:
  explicit Reader(Contents contents) : Reads(std::move(contents)) {}
};

}  // namespace mapp::memory
