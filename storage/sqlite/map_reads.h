#pragma once

#include "storage/map_store.h"
#include "storage/sqlite/catalog.h"
#include "storage/sqlite/compaction.h"
#include "storage/sqlite/erasure.h"
#include "storage/sqlite/evidence.h"
#include "storage/sqlite/frames.h"
#include "storage/sqlite/place_blocks.h"
#include "storage/sqlite/points.h"
#include "storage/sqlite/revisions.h"
#include "storage/sqlite/tiles.h"
#include "storage/sqlite/world_changes.h"

#include <optional>
#include <span>
#include <string>
#include <vector>

namespace mapp::sqlite {

/// The reading half of `Interface` (MapReader, or MapWriter, which reads too) on one connection.
template <typename Interface>
class MapReads : public Interface {
 public:
  explicit MapReads(Connection& db) : db_(db) {}

  StatusOr<std::vector<MapRecord>> ListMaps() override { return sqlite::ListMaps(db_); }
  StatusOr<MapRecord> FindMap(const std::string& name) override { return sqlite::FindMap(db_, name); }
  StatusOr<MapRecord> GetMap(MapId map) override { return sqlite::GetMap(db_, map); }
  StatusOr<std::vector<SessionRecord>> ListSessions(std::optional<MapId> map) override {
    return sqlite::ListSessions(db_, map);
  }
  StatusOr<SessionRecord> GetSession(SessionId session) override { return sqlite::GetSession(db_, session); }
  StatusOr<CameraRecord> GetCamera(CameraId camera) override { return sqlite::GetCamera(db_, camera); }

  StatusOr<std::optional<FrameId>> FindFrame(SessionId session, uint32_t number) override {
    return sqlite::FindFrame(db_, session, number);
  }
  StatusOr<FrameRecord> GetFrame(FrameId frame) override { return sqlite::GetFrame(db_, frame); }
  StatusOr<std::vector<FrameRecord>> ListFrames(MapId map, std::optional<SessionId> session) override {
    return sqlite::ListFrames(db_, map, session);
  }
  StatusOr<std::vector<FrameRecord>> FramesInBox(MapId map, const Aabb& box_map) override {
    return sqlite::FramesInBox(db_, map, box_map);
  }
  StatusOr<std::string> GetPacket(FrameId frame) override { return sqlite::GetPacket(db_, frame); }
  StatusOr<std::vector<Observation>> GetObservations(FrameId frame) override {
    return sqlite::GetObservations(db_, frame);
  }

  StatusOr<std::vector<PointRecord>> GetPoints(std::span<const MapPointId> points) override {
    return sqlite::GetPoints(db_, points);
  }
  StatusOr<std::vector<PointRecord>> FindPoints(std::span<const MapPointId> points) override {
    return sqlite::FindPoints(db_, points);
  }
  StatusOr<std::vector<std::optional<MapPointId>>> FindSessionPoints(
      SessionId session, std::span<const uint64_t> session_points) override {
    return sqlite::FindSessionPoints(db_, session, session_points);
  }
  StatusOr<std::vector<NumberedPoint>> ListNumberedPoints(SessionId session) override {
    return sqlite::ListNumberedPoints(db_, session);
  }
  StatusOr<std::vector<PointRecord>> PointsInTile(MapId map, const TileKey& tile) override {
    return sqlite::PointsInTile(db_, map, tile);
  }
  StatusOr<std::vector<PointRecord>> PointsOfSession(SessionId session) override {
    return sqlite::PointsOfSession(db_, session);
  }
  StatusOr<std::vector<TileRecord>> ListTiles(MapId map, const std::optional<Aabb>& box_map) override {
    return sqlite::ListTiles(db_, map, box_map);
  }
  StatusOr<std::optional<TileBlob>> GetTileBlob(MapId map, const TileKey& tile) override {
    return sqlite::GetTileBlob(db_, map, tile);
  }
  StatusOr<std::vector<std::string>> ListPlaceBlocks(MapId map) override { return sqlite::ListPlaceBlocks(db_, map); }

  StatusOr<std::vector<EvidenceRecord>> ListEvidence(SessionId session) override {
    return sqlite::ListEvidence(db_, session);
  }
  StatusOr<bool> HasEvidence(SessionId session, uint32_t number) override {
    return sqlite::HasEvidence(db_, session, number);
  }
  StatusOr<std::optional<std::string>> FindFindings(SessionId session) override {
    return sqlite::FindFindings(db_, session);
  }
  StatusOr<std::vector<ChangeRecord>> ListChanges(MapId map) override { return sqlite::ListChanges(db_, map); }
  StatusOr<ChangeRecord> GetChange(ChangeId change) override { return sqlite::GetChange(db_, change); }

  StatusOr<std::vector<RevisionRecord>> ListRevisions(MapId map, Revision first, Revision last) override {
    return sqlite::ListRevisions(db_, map, first, last);
  }
  StatusOr<std::vector<TagRecord>> ListTags(MapId map) override { return sqlite::ListTags(db_, map); }
  StatusOr<std::vector<SessionDiff>> DiffRevisions(MapId map, Revision from, Revision to) override {
    return sqlite::DiffRevisions(db_, map, from, to);
  }
  StatusOr<int64_t> CountHistory(MapId map, Revision oldest) override { return sqlite::CountHistory(db_, map, oldest); }

 protected:
  Connection& db_;
};

}  // namespace mapp::sqlite
