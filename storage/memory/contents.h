#pragma once

#include "storage/memory/persistent_map.h"
#include "storage/records.h"

#include <cstdint>
#include <memory>
#include <optional>
#include <string>
#include <tuple>
#include <utility>
#include <variant>
#include <vector>

namespace mapp::memory {

struct StoredFrame {
  FrameRecord record;
  std::shared_ptr<const std::string> packet;
  std::shared_ptr<const std::vector<Observation>> observations;
};

struct StoredTile {
  Revision revision;       ///< as TileRecord::revision
  int64_t num_points = 0;  ///< 0 stays, so that the revision goes on counting
  std::shared_ptr<const TileBlob> blob;
};

/// A key that says all.
using Present = std::monostate;

/// One map at one time, with all that is in it. A copy shares what is equal.
struct MapState {
  MapRecord record;
  PersistentMap<SessionId, SessionRecord> sessions;
  PersistentMap<FrameId, StoredFrame> frames;
  PersistentMap<std::pair<SessionId, uint32_t>, FrameId> frames_by_number;
  PersistentMap<MapPointId, PointRecord> points;  ///< live
  PersistentMap<MapPointId, std::optional<MapPointId>> retired;
  /// All that there ever were, by the device's number; the greatest id of a number is the current one.
  PersistentMap<std::tuple<SessionId, uint64_t, MapPointId>, Present> session_points;
  PersistentMap<TileKey, StoredTile> tiles;
  PersistentMap<std::pair<TileKey, MapPointId>, Present> tile_points;  ///< live, in the map
  PersistentMap<uint64_t, std::string> place_blocks;                   ///< count from 0
  uint64_t num_place_blocks = 0;
  PersistentMap<std::pair<SessionId, uint32_t>, EvidenceRecord> evidence;
  PersistentMap<SessionId, std::string> findings;
  PersistentMap<ChangeId, ChangeRecord> changes;
  PersistentMap<Revision, RevisionRecord> revisions;
  PersistentMap<std::string, TagRecord> tags;
};
using MapStatePtr = std::shared_ptr<const MapState>;

/// The ids that come next. Never taken back but with a change that failed.
struct NextIds {
  uint64_t map = 1, camera = 1, session = 1, frame = 1, point = 1, change = 1;
};

/// All that a store keeps, at one time. What has been published is never changed; a copy costs nothing.
struct Contents {
  PersistentMap<MapId, MapStatePtr> maps;
  /// The last state that had the revision, of every map.
  PersistentMap<std::pair<MapId, Revision>, MapStatePtr> versions;
  PersistentMap<CameraId, Camera> cameras;
  NextIds next;

  /// Null when there is none.
  const MapState* FindMap(MapId map) const;
  const MapState* FindMap(const std::string& name) const;
  // The map that holds it, null when none does. Each map is asked: there are few.
  const MapState* MapOfSession(SessionId session) const;
  const MapState* MapOfFrame(FrameId frame) const;
  const MapState* MapOfPoint(MapPointId live_point) const;
  const MapState* MapOfChange(ChangeId change) const;

  /// The map's state at a revision that it has had (internal::CheckRevision).
  const MapState& At(const MapState& map, Revision revision) const;
  /// Revisions before `oldest` whose states are kept: the rows of this engine's history.
  std::vector<Revision> VersionsBefore(MapId map, Revision oldest) const;
  /// What MapStore::ReadAsOf shows.
  StatusOr<Contents> AsOf(MapId map, Revision revision) const;
};

}  // namespace mapp::memory
