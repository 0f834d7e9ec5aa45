#pragma once

#include "mapp/base/call_context.h"
#include "mapp/base/status.h"
#include "storage/records.h"

#include <functional>
#include <memory>
#include <optional>
#include <span>
#include <string>
#include <vector>

namespace mapp {

/// Reads of one consistent state. NOT_FOUND names the missing thing; DATA_LOSS a corrupt row or page; UNAVAILABLE a
/// database that stays locked. One thread at a time.
class MapReader {
 public:
  virtual ~MapReader() = default;

  virtual StatusOr<std::vector<MapRecord>> ListMaps() = 0;
  virtual StatusOr<MapRecord> FindMap(const std::string& name) = 0;
  virtual StatusOr<MapRecord> GetMap(MapId map) = 0;
  /// All sessions, or one map's, oldest first.
  virtual StatusOr<std::vector<SessionRecord>> ListSessions(std::optional<MapId> map) = 0;
  virtual StatusOr<SessionRecord> GetSession(SessionId session) = 0;
  virtual StatusOr<CameraRecord> GetCamera(CameraId camera) = 0;

  /// The frame stored for (session, keyframe number), if any: the upload's idempotency check.
  virtual StatusOr<std::optional<FrameId>> FindFrame(SessionId session, uint32_t number) = 0;
  virtual StatusOr<FrameRecord> GetFrame(FrameId frame) = 0;
  /// Ordered by id. With `session` only that session's.
  virtual StatusOr<std::vector<FrameRecord>> ListFrames(MapId map, std::optional<SessionId> session) = 0;
  /// Frames in the map whose camera centre lies in `box_map` (R*Tree), ordered by id.
  virtual StatusOr<std::vector<FrameRecord>> FramesInBox(MapId map, const Aabb& box_map) = 0;
  /// The keyframe's bytes as the device sent them (keyframe log).
  virtual StatusOr<std::string> GetPacket(FrameId frame) = 0;
  virtual StatusOr<std::vector<Observation>> GetObservations(FrameId frame) = 0;

  /// Live points, in the order asked; NOT_FOUND when one is unknown or retired.
  virtual StatusOr<std::vector<PointRecord>> GetPoints(std::span<const MapPointId> points) = 0;
  /// As GetPoints, but leaves out ids that are unknown or retired.
  virtual StatusOr<std::vector<PointRecord>> FindPoints(std::span<const MapPointId> points) = 0;
  /// For each of the session's point numbers: the live map point it stands for now (fusion followed), or nullopt.
  virtual StatusOr<std::vector<std::optional<MapPointId>>> FindSessionPoints(
      SessionId session, std::span<const uint64_t> session_points) = 0;
  /// Every point that the session has given a number, those that live no more too, ordered by number and id.
  virtual StatusOr<std::vector<NumberedPoint>> ListNumberedPoints(SessionId session) = 0;
  virtual StatusOr<std::vector<PointRecord>> PointsInTile(MapId map, const TileKey& tile) = 0;
  /// Live points created by the session, in the map or in its fragment.
  virtual StatusOr<std::vector<PointRecord>> PointsOfSession(SessionId session) = 0;
  /// Non-empty tiles whose cube meets `box_map` (R*Tree); all of the map's without a box.
  virtual StatusOr<std::vector<TileRecord>> ListTiles(MapId map, const std::optional<Aabb>& box_map) = 0;
  /// The encoded tile last put, if any; its revision may be older than the tile's.
  virtual StatusOr<std::optional<TileBlob>> GetTileBlob(MapId map, const TileKey& tile) = 0;
  /// What the place index stored of the map, in that order. It is for its reader to check (vision/place_block.h).
  virtual StatusOr<std::vector<std::string>> ListPlaceBlocks(MapId map) = 0;

  /// What the session's device has reported of the map's points, by number. DATA_LOSS names session and number.
  virtual StatusOr<std::vector<EvidenceRecord>> ListEvidence(SessionId session) = 0;
  /// Whether a report of that number is stored.
  virtual StatusOr<bool> HasEvidence(SessionId session, uint32_t number) = 0;
  /// What was last put; nullopt when nothing has been since, or it was dropped. DATA_LOSS: make it again.
  virtual StatusOr<std::optional<std::string>> FindFindings(SessionId session) = 0;
  /// By id.
  virtual StatusOr<std::vector<ChangeRecord>> ListChanges(MapId map) = 0;
  virtual StatusOr<ChangeRecord> GetChange(ChangeId change) = 0;

  /// The map's revisions in [first, last], ascending. A change that made none (a session was opened) is not listed.
  virtual StatusOr<std::vector<RevisionRecord>> ListRevisions(MapId map, Revision first, Revision last) = 0;
  /// By name.
  virtual StatusOr<std::vector<TagRecord>> ListTags(MapId map) = 0;
  /// How the map at `to` differs from the map at `from`, by session; sessions without a difference are left out.
  /// INVALID_ARGUMENT when from > to; OUT_OF_RANGE as ReadAsOf.
  virtual StatusOr<std::vector<SessionDiff>> DiffRevisions(MapId map, Revision from, Revision to) = 0;
  /// Rows of history that no revision from `oldest` on needs: what DropHistory would drop.
  virtual StatusOr<int64_t> CountHistory(MapId map, Revision oldest) = 0;
};

/// Reads and changes inside one transaction; reads see the changes made so far. A call refused for what it asks for
/// (INVALID_ARGUMENT, NOT_FOUND, ALREADY_EXISTS, OUT_OF_RANGE) has changed nothing: the change may go on without it.
class MapWriter : public MapReader {
 public:
  /// ALREADY_EXISTS when the name is taken; INVALID_ARGUMENT for a tile edge, range or feature settings that cannot be.
  /// Id and revision 0 are set by the store, and created_ns when it is 0.
  virtual StatusOr<MapId> CreateMap(const MapRecord& map) = 0;
  /// Deletes the map with its sessions, log, frames, points, tiles, evidence and changes.
  virtual Status DeleteMap(MapId map) = 0;
  virtual Status SetFounder(MapId map, std::optional<SessionId> founder) = 0;
  /// MapRecord::has_metric_scale.
  virtual Status SetMetricScale(MapId map, bool has_metric_scale) = 0;
  /// The next map, session and frame get these ids or greater ones; those of a default id as they come.
  virtual Status SkipIds(MapId map, SessionId session, FrameId frame) = 0;
  virtual StatusOr<CameraId> InsertCamera(const Camera& camera) = 0;
  /// Id is set by the store, and opened_ns when it is 0.
  virtual StatusOr<SessionId> InsertSession(const SessionRecord& session) = 0;
  /// Writes closed_ns, T_map_session with its scale, aligned_at_keyframe, optimized and quarantine of the session.
  /// INVALID_ARGUMENT: a pose that is not finite, a scale that is not positive.
  virtual Status UpdateSession(const SessionRecord& session) = 0;

  /// Revision of this transaction for `map`: the map's next one, the same however often it is asked in one Write.
  virtual StatusOr<Revision> NextRevision(MapId map) = 0;
  /// What ListRevisions says of this transaction's revision of `map`. Without it, InsertFrame's session is noted with
  /// kKeyframe. The last call counts; kUnknown is INVALID_ARGUMENT.
  virtual Status SetCause(MapId map, RevisionCause cause, std::optional<SessionId> session) = 0;
  /// Names a revision; an existing tag of that name moves. INVALID_ARGUMENT: an empty name, or one that is a number.
  /// OUT_OF_RANGE as ReadAsOf.
  virtual Status PutTag(MapId map, const std::string& name, Revision revision) = 0;
  /// NOT_FOUND: no such tag.
  virtual Status DeleteTag(MapId map, const std::string& name) = 0;
  /// From now on `oldest` is the map's oldest revision (never an older one than before), and up to about `max_rows`
  /// rows of history that none from it on needs are gone; returns how many. Again until it says 0: one change need not
  /// keep others waiting for a whole history. OUT_OF_RANGE: the map has no such revision yet.
  virtual StatusOr<int64_t> DropHistory(MapId map, Revision oldest, int64_t max_rows) = 0;
  /// Gives up to `max_bytes` of the engine's unused space back to the system; returns how much is left to give.
  virtual StatusOr<int64_t> GiveBackSpace(int64_t max_bytes) = 0;

  /// Makes a live point another session's, as if that had founded it: its number for it is `session_point`. In place,
  /// no history. INVALID_ARGUMENT: the session is of another map.
  virtual Status AdoptPoint(MapPointId point, SessionId session, uint64_t session_point,
                            const OrbDescriptor& descriptor) = 0;
  /// Removes all that is known of a session: its record, what its device sent and what was made of that, with the
  /// encoded tiles, the place blocks and the findings of its map, which are derived and may show it. Changes rest on it
  /// no more; those that rested on nothing else are deleted. Rewrite() then removes what is left in the engine's files.
  /// FAILED_PRECONDITION: a frame of it stands in the map, a live point is its own, it is the founder, or the map can
  /// be read as it was before this change (DropHistory).
  virtual Status EraseSession(SessionId session) = 0;

  /// Appends the packet to the keyframe log and the frame to the map, with `observations`. Id and `created` are set by
  /// the store. ALREADY_EXISTS when (session, number) is stored.
  virtual StatusOr<FrameId> InsertFrame(const FrameRecord& frame, const std::string& packet,
                                        std::span<const Observation> observations) = 0;
  /// A new version of the frame's pose (and of in_map); the old one stays readable at older revisions.
  virtual Status SetFramePose(FrameId frame, bool in_map, const Pose3& T_frame_camera) = 0;
  /// A new version of the frame's observations.
  virtual Status SetObservations(FrameId frame, std::span<const Observation> observations) = 0;

  /// Id and `created` are set by the store. `tile` of the point follows from its position when in_map.
  virtual StatusOr<MapPointId> InsertPoint(MapId map, const PointRecord& point) = 0;
  /// A new version: position, direction, descriptor, in_map; the old one stays readable at older revisions.
  virtual Status UpdatePoint(const PointRecord& point) = 0;
  /// Counters of the live version in place, no history: num_observations, confidence, observers, descriptor,
  /// view_direction, reference_distance_m. (History of these follows from the observations.) The rest of the record is
  /// as read: an upload touches hundreds of points, and none of them is looked up for it.
  virtual Status TouchPoint(const PointRecord& point) = 0;
  /// Ends the point at this revision. `fused_into`: the point that now stands for it; FindSessionPoints follows it.
  virtual Status RetirePoint(MapPointId point, std::optional<MapPointId> fused_into) = 0;
  /// Undoes RetirePoint(.., nullopt): the point lives again under its id, as a new version with all that the record
  /// says; `created` is set by the store. NOT_FOUND: there never was such a point. ALREADY_EXISTS: it lives.
  /// INVALID_ARGUMENT: it was fused into another, or is not the point of that number of the record's session.
  virtual Status ReturnPoint(const PointRecord& point) = 0;
  virtual Status PutTileBlob(MapId map, const TileKey& tile, const TileBlob& blob) = 0;
  /// Appends to ListPlaceBlocks(). No revision: frames and points stay as they are.
  virtual Status AppendPlaceBlock(MapId map, const std::string& block) = 0;

  // What follows makes no revision: frames and points stay as they are.

  /// received_ns is set by the store when it is 0. ALREADY_EXISTS when (session, number) is stored.
  virtual Status AppendEvidence(const EvidenceRecord& evidence) = 0;
  /// What was derived from the session's part of the history, in the caller's own format; replaces what was there.
  virtual Status PutFindings(SessionId session, const std::string& findings) = 0;
  /// Of all of the map's sessions.
  virtual Status DropFindings(MapId map) = 0;
  /// A new change when the record's id is the default one, and gives it an id that no other had; else replaces the one
  /// of this id (NOT_FOUND: there is none). INVALID_ARGUMENT names the field: a confidence outside of [0, 1], a box
  /// that is not finite and positive or is missing though the kind has it, times the wrong way round, ids that do not
  /// ascend, a session or a change of another map. NOT_FOUND: no such map or session.
  virtual StatusOr<ChangeId> PutChange(const ChangeRecord& change) = 0;
  virtual Status DeleteChange(ChangeId change) = 0;
};

/// The map database. Thread-safe.
class MapStore {
 public:
  virtual ~MapStore() = default;

  /// An immutable view of the last commit; never blocks the writer. Keep it short: it pins the write-ahead log.
  virtual StatusOr<std::unique_ptr<MapReader>> Read() = 0;

  /// One map as it was at `revision`, with what was changed at it without a revision of its own: the last state that
  /// had this number. Other maps, and what came later, do not exist for the reader. Place blocks, tags, evidence,
  /// findings and changes are as they are now, and so may be a point's counters, descriptor and direction where they
  /// changed in place (see TouchPoint); a tile's revision is at most `revision`. NOT_FOUND: no such map. OUT_OF_RANGE:
  /// it has no such revision, or it has been compacted away.
  virtual StatusOr<std::unique_ptr<MapReader>> ReadAsOf(MapId map, Revision revision) = 0;

  /// Runs `change` while no other runs, on a thread of the store's choice, and returns when it is durable. Changes that
  /// wait together may share one commit; each sees those before it; one that returns an error, or throws (INTERNAL), is
  /// undone alone and its error returned. `on_commit`, if given, runs after the commit, in commit order, before Write
  /// returns and before any later change's: publish caches there. Neither may call Write.
  /// RESOURCE_EXHAUSTED on a full disk, DEADLINE_EXCEEDED when the deadline passed before the change began. UNAVAILABLE
  /// when the disk fails: nobody reads anything of the change, but should the process end before a later one is
  /// durable, it may be there when the store is opened again, whole. A change that has begun is never abandoned.
  virtual Status Write(const CallContext& context, std::function<Status(MapWriter&)> change,
                       std::function<void()> on_commit = {}) = 0;

  /// Writes all anew, so that nothing of what was deleted is left in the engine's files, nor unused space; changes wait
  /// meanwhile. UNAVAILABLE: readers of an older state kept some of it; it goes when the store closes.
  /// RESOURCE_EXHAUSTED on a full disk: then nothing has changed.
  virtual Status Rewrite(const CallContext& context) = 0;

  /// Finishes queued writes, checkpoints and closes; later calls give UNAVAILABLE. Idempotent.
  virtual Status Close() = 0;
};

}  // namespace mapp
