// Each kind of violation, made by one SQL statement on a copy of a healthy database, is found under its check's name.

#include "storage/sqlite/blobs.h"
#include "tests/unit/server/verify/healthy_database.h"

#include <fmt/format.h>
#include <gmock/gmock.h>

#include <algorithm>

namespace mapp::testing {
namespace {

struct Case {
  std::string name;
  std::string sql;
  std::string check;
  std::string message;  ///< part of it
};

/// As an SQL literal.
std::string Blob(const std::string& bytes) {
  std::string literal = "x'";
  for (const char byte : bytes) literal += fmt::format("{:02x}", static_cast<uint8_t>(byte));
  return literal + "'";
}

std::string Observations(const std::vector<Observation>& observations) {
  return Blob(sqlite::EncodeObservations(observations));
}

/// Makes the last frame in the map observe so.
std::string Observe(const std::vector<Observation>& observations) {
  return "UPDATE frame_observations SET observations = " + Observations(observations) +
         " WHERE frame_id = (SELECT max(frame_id) FROM frames WHERE in_map)";
}

std::string PutPacket(const std::string& packet_and_crc32c) {
  return "UPDATE keyframe_log SET (packet, crc32c) = (" + packet_and_crc32c + ") WHERE frame_id = 2";
}

std::vector<Case> FileCases() {
  return {
      {"StaleIndex",
       "PRAGMA writable_schema = ON; UPDATE sqlite_schema SET sql = 'CREATE INDEX sessions_by_map ON sessions "
       "(opened_ns)' WHERE name = 'sessions_by_map'",
       "integrity", "sessions_by_map"},
      {"FrameIndexTorn", "DELETE FROM frame_index_rowid WHERE rowid = (SELECT min(rowid) FROM frame_index_rowid)",
       "rtree", "Mapping"},
      {"TileIndexTorn", "DELETE FROM tile_index_rowid WHERE rowid = (SELECT min(rowid) FROM tile_index_rowid)", "rtree",
       "Mapping"},
      {"LogOfNoSession", "UPDATE keyframe_log SET session_id = 999 WHERE frame_id = 3", "foreign_keys",
       "of keyframe_log refers to a row of sessions"},
      {"MissingTable", "DROP TABLE tags", "sqlite", "tags did not get to its end: map database: no such table"},
  };
}

std::vector<Case> CatalogCases() {
  return {
      {"TileEdge", "UPDATE maps SET tile_edge_m = -8", "maps", "tile edge -8 m"},
      {"FeatureSettings", "UPDATE maps SET feature_num_levels = 0", "maps", "levels"},
      {"ConeRange", "UPDATE maps SET cone_range_m = 9e999", "maps", "cone range"},
      {"OldestRevision", "UPDATE maps SET oldest_revision = revision + 1", "maps", "cannot be together"},
      {"Founder", "UPDATE maps SET founder_session_id = 999", "maps", "founder session 999"},
      {"FrameCounter", "UPDATE maps SET num_frames = num_frames + 1", "map_counters", "num_frames is"},
      {"PointCounter", "UPDATE maps SET num_points = num_points - 1", "map_counters", "num_points is"},
      {"SessionCounter", "UPDATE maps SET num_sessions = 0", "map_counters", "num_sessions is 0"},
      {"MapHistoryBackwards", "UPDATE map_history SET retired_revision = created_revision", "map_history",
       "is of no map or beyond"},
      {"MapHistoryOverlaps",
       "DELETE FROM map_history; INSERT INTO map_history SELECT map_id, 0, 3, NULL, 1 FROM maps UNION ALL SELECT "
       "map_id, 2, 4, NULL, 1 FROM maps",
       "map_history", "versions of revisions 0 and 2 overlap"},
      {"CameraModel", "UPDATE cameras SET model = 'pinhole-ish' WHERE camera_id = 1", "cameras", "pinhole-ish"},
      {"CameraImage", "UPDATE cameras SET width_px = 0 WHERE camera_id = 1", "cameras", "image of 0 x"},
      {"Sensor", "UPDATE sessions SET sensor = 9 WHERE session_id = 1", "sessions", "unknown sensor kind 9"},
      {"Scale", "UPDATE sessions SET scale_map_session = 0 WHERE session_id = 1", "sessions", "scale 0"},
      {"SessionPose", "UPDATE sessions SET qw = 2 WHERE session_id = 1", "sessions", "T_map_session is no pose"},
      {"HalfASessionPose", "UPDATE sessions SET ty_m = NULL WHERE session_id = 1", "sessions",
       "T_map_session is no pose"},
      {"SessionState", "UPDATE sessions SET state_revision = 999999 WHERE session_id = 1", "sessions",
       "state of 999999"},
      {"KeyframeCounter", "UPDATE sessions SET num_keyframes = 5 WHERE session_id = 1", "session_counters",
       "num_keyframes is 5"},
      {"ByteCounter", "UPDATE sessions SET num_upload_bytes = 5 WHERE session_id = 1", "session_counters",
       "num_upload_bytes 5"},
      {"SessionHistoryBeyond", "UPDATE session_history SET retired_revision = 999999", "session_history",
       "beyond its state"},
      {"SessionHistoryOfNone", "UPDATE session_history SET session_id = session_id + 900", "session_history",
       "is of no session"},
      {"MissingRevision", "DELETE FROM revisions WHERE revision = 3", "revisions", "have a row"},
      {"RevisionToCome", "INSERT INTO revisions SELECT map_id, revision + 1, 1, NULL, 0 FROM maps", "revisions",
       "the map is at"},
      {"Cause", "UPDATE revisions SET cause = 99 WHERE revision = 2", "revisions", "unknown cause 99"},
      {"RevisionOfNone", "UPDATE revisions SET session_id = 999 WHERE revision = 2", "revisions", "session 999"},
      {"TagOfNothing", "UPDATE tags SET revision = 999999", "tags", "tag \"spring\" names revision 999999"},
      {"IdSequence", "UPDATE id_sequences SET next_id = 7", "id_sequence", "the next one to be made is 7"},
      {"NoIdSequence", "DELETE FROM id_sequences", "id_sequence", "the next one to be made is"},
      {"PlaceBlockOfNone", "INSERT INTO place_blocks VALUES (999, 0, x'00')", "place_blocks", "of no map"},
      {"PlaceBlock", "INSERT INTO place_blocks SELECT map_id, 900, x'00' FROM maps", "place_blocks",
       "place block 900: "},
  };
}

std::vector<Case> ChangeCases() {
  return {
      {"EvidenceOfNone", "UPDATE evidence SET session_id = 999", "evidence", "evidence 0 is of no session"},
      {"EvidenceNumber", "UPDATE evidence SET number = -1", "evidence", "evidence has the number -1"},
      {"EvidenceChecksum", "UPDATE evidence SET packet = x'00'", "evidence", "evidence 0: crc32c"},
      {"FindingsOfNone", "UPDATE findings SET session_id = 999", "findings", "findings are of no session"},
      {"FindingsChecksum", "UPDATE findings SET blob = x'00'", "findings", "findings: crc32c"},
      {"ChangeOfNoMap", "UPDATE changes SET map_id = 999", "changes", "map 999 does not exist"},
      {"ChangeDetected", "UPDATE changes SET detected_revision = 999999", "changes", "detected at revision 999999"},
      {"ChangeApplied", "UPDATE changes SET applied_revision = 999999", "changes", "applied at 999999"},
      {"ChangeKind", "UPDATE changes SET kind = 256", "changes", "change.kind: unknown"},
      {"ChangeStatus", "UPDATE changes SET status = 4", "changes", "change.status: unknown"},
      {"ChangeConfidence", "UPDATE changes SET confidence = 1.5", "changes", "change.confidence: must be in [0, 1]"},
      {"ChangeTimes", "UPDATE changes SET after_ns = before_ns + 1", "changes", "is later than before_ns"},
      {"ChangeSeen", "UPDATE changes SET first_seen_ns = last_seen_ns + 1", "changes", "is later than last_seen_ns"},
      {"ChangeWithoutBox", "UPDATE changes SET after_tx_m = NULL", "changes", "change.box_after: is missing"},
      {"ChangeWithHalfABox", "UPDATE changes SET after_tx_m = NULL", "changes", "box_after is no box"},
      {"ChangeBoxTurned", "UPDATE changes SET before_qw = before_qw + 0.1", "changes", "box_before is no box"},
      {"ChangeBoxSize", "UPDATE changes SET before_size_y_m = 0", "changes", "change.box_before: must be finite"},
      {"ChangeSessions", "UPDATE changes SET sessions = x'0100'", "changes", "list of sessions is malformed"},
      {"ChangePoints", "UPDATE changes SET points_after = x'80'", "changes", "list of points is malformed"},
      {"ChangeOnNoSession", "UPDATE changes SET sessions = x'017f'", "changes", "rests on session 128"},
      {"ChangeSequence", "UPDATE sqlite_sequence SET seq = 0 WHERE name = 'changes'", "change_sequence",
       "the greatest that was given is 0"},
  };
}

std::vector<Case> FrameCases() {
  return {
      {"LogWithoutFrame", "DELETE FROM frames WHERE frame_id = 2", "keyframe_log", "in no row of frames"},
      {"PacketChecksum", "UPDATE keyframe_log SET packet = zeroblob(length(packet)) WHERE frame_id = 2", "packets",
       "packet: crc32c"},
      // The checksum of one zero byte.
      {"PacketOfNoFormat", PutPacket("x'00', 1383945041"), "packets", "packet: "},
      {"PacketOfAnother", PutPacket("SELECT packet, crc32c FROM keyframe_log WHERE frame_id = 1"), "packets",
       "packet says number 0, its row 1"},
      {"Stamp", "UPDATE frames SET stamp_ns = stamp_ns + 1 WHERE frame_id = 2", "packets", "packet says stamp_ns"},
      {"FeatureCounter", "UPDATE frames SET num_features = 7 WHERE frame_id = 2", "packets", "its row 7"},
      {"Overlap", "UPDATE frames SET overlap = 0.5 WHERE frame_id = 2", "packets",
       "packet says overlap -1, its row 0.5"},
      {"FrameNumber", "UPDATE frames SET number = 77 WHERE frame_id = 2", "frames", "is keyframe 77"},
      {"PacketBytes", "UPDATE frames SET num_packet_bytes = 7 WHERE frame_id = 2", "frames", "num_packet_bytes is 7"},
      {"FrameOfAnotherMap", "UPDATE frames SET map_id = 999 WHERE frame_id = 2", "frames", "map 999"},
      {"FrameOfAnotherCamera", "UPDATE frames SET camera_id = 999 WHERE frame_id = 2", "frames", "camera 999"},
      {"PoseToCome", "UPDATE frames SET pose_revision = 999999 WHERE frame_id = 2", "frames", "the pose of 999999"},
      {"FrameBoolean", "UPDATE frames SET partial = 2 WHERE frame_id = 2", "frames", "neither 0 nor 1"},
      {"InfinitePose", "UPDATE frames SET tx_m = 9e999 WHERE frame_id = 2", "poses", "pose is not finite"},
      {"Quaternion", "UPDATE frames SET qx = qx + 0.1 WHERE frame_id = 2", "poses", "no unit one"},
      {"EarlierQuaternion", "UPDATE frame_pose_history SET qy = 3", "poses", "pose of revision"},
      {"PoseHistoryOverlapsLive", "UPDATE frame_pose_history SET retired_revision = 999999", "pose_history",
       "its live pose of"},
      {"PoseHistoryOfNone", "UPDATE frame_pose_history SET frame_id = frame_id + 900", "pose_history", "pose of"},
      {"PoseHistoryOverlaps",
       "INSERT INTO frame_pose_history SELECT frame_id, created_revision + 1, retired_revision, in_map, tx_m, ty_m, "
       "tz_m, qw, qx, qy, qz FROM frame_pose_history WHERE retired_revision > created_revision + 1 LIMIT 1",
       "pose_history", "overlap"},
      {"NoObservations", "DELETE FROM frame_observations WHERE frame_id = 2", "observations", "has no row in"},
      {"ObservationsToCome", "UPDATE frame_observations SET created_revision = 999999 WHERE frame_id = 2",
       "observations", "observations of revision 999999"},
      {"ObservationChecksum", "UPDATE frame_observations SET observations = x'0100deadbeef' WHERE frame_id = 2",
       "observations", "checksum differs"},
      {"FeatureOutOfBounds", Observe({{60'000, MapPointId(1), 1}}), "observations", "observes with feature 60000 of"},
      {"FeatureTwice", Observe({{5, MapPointId(1), 1}, {5, MapPointId(2), 1}}), "observations",
       "feature 5 observes twice"},
      {"PointTwice", Observe({{5, MapPointId(1), 1}, {6, MapPointId(1), 1}}), "observations", "observes point 1 twice"},
      {"ObservedDepth", Observe({{5, MapPointId(1), -1}}), "observations", "at depth -1 m"},
      {"ObservedPointOfNone", Observe({{5, MapPointId(999'999'999), 1}}), "observations",
       "observes point 999999999, which the map never had"},
      {"LostPoint", "DELETE FROM points WHERE point_id = (SELECT max(point_id) FROM points)", "observations",
       "which the map never had"},
      {"EarlierObservations",
       "UPDATE frame_observation_history SET observations = " + Observations({{5, MapPointId(999'999'999), 1}}),
       "observation_history", "which the map never had"},
      {"ObservationHistoryOverlapsLive", "UPDATE frame_observation_history SET retired_revision = 999999",
       "observation_history", "the live ones of"},
      {"ObservationHistoryOverlaps",
       "INSERT INTO frame_observation_history SELECT frame_id, created_revision + 1, retired_revision, observations "
       "FROM frame_observation_history WHERE retired_revision > created_revision + 1 LIMIT 1",
       "observation_history", "overlap"},
  };
}

std::vector<Case> PointCases() {
  const std::string one = " WHERE point_id = (SELECT min(point_id) FROM points WHERE tile_id IS NOT NULL)";
  return {
      {"InfinitePosition", "UPDATE points SET x_m = 9e999" + one, "points", "row is malformed"},
      {"Descriptor", "UPDATE points SET descriptor = x'00'" + one, "points", "row is malformed"},
      {"Direction", "UPDATE points SET view_direction = zeroblob(12)" + one, "points", "view direction has length 0"},
      {"Confidence", "UPDATE points SET confidence = 1.5" + one, "points", "confidence 1.5 is not in [0, 1]"},
      {"ReferenceDistance", "UPDATE points SET reference_distance_m = 9e999" + one, "points",
       "reference distance is not finite"},
      {"ObserversMalformed", "UPDATE points SET observers = x'80'" + one, "points", "row is malformed"},
      {"TooManyObservers", "UPDATE points SET observers = x'0101010101'" + one, "points", "names 5 observers"},
      {"PointOfNoSession", "UPDATE points SET session_id = 999" + one, "points", "session 999 does not exist"},
      {"PointToCome", "UPDATE points SET created_revision = 999999" + one, "points", "version of revisions 999999"},
      {"EarlierConfidence", "UPDATE point_history SET confidence = -1", "point_history", "confidence -1"},
      {"PointHistoryBackwards", "UPDATE point_history SET retired_revision = created_revision - 1", "point_history",
       "version of revisions"},
      {"PointHistoryOverlapsLive",
       "INSERT INTO point_history SELECT point_id, created_revision, created_revision + 1, NULL, session_id, "
       "session_point, tile_id, x_m, y_m, z_m, view_direction, descriptor, reference_distance_m, num_observations, "
       "confidence, observers FROM points" +
           one,
       "point_history", "overlaps the live one"},
      {"PointHistoryOverlaps",
       "INSERT INTO point_history SELECT point_id, created_revision + 1, retired_revision, NULL, session_id, "
       "session_point, tile_id, x_m, y_m, z_m, view_direction, descriptor, reference_distance_m, num_observations, "
       "confidence, observers FROM point_history WHERE retired_revision > created_revision + 1 LIMIT 1",
       "point_history", "overlap"},
      {"PointOfNoTile", "UPDATE points SET tile_id = 999" + one, "point_tiles", "tile 999 does not exist"},
      {"PointOutOfItsTile", "UPDATE points SET y_m = y_m + 100" + one, "point_tiles", "m is not in its tile"},
      {"EarlierPointOutOfItsTile", "UPDATE point_history SET y_m = y_m + 100", "point_tiles", "m is not in its tile"},
      {"TileOfAnotherMap", "UPDATE tiles SET map_id = 999", "point_tiles", "of map 999, the point of another"},
      {"NumberOfNoPoint", "UPDATE session_points SET point_id = 999999999 WHERE point_id = 5", "session_points",
       "no such point was ever made"},
      {"PointWithoutNumber", "DELETE FROM session_points WHERE point_id = 5", "session_points",
       "no number of session 1"},
      {"FusedIntoNone", "UPDATE point_history SET fused_into = 999999999 WHERE fused_into IS NOT NULL", "fusions",
       "which does not exist"},
      {"FusedInACircle",
       "UPDATE point_history SET fused_into = point_id WHERE point_id = (SELECT max(point_id) FROM point_history WHERE "
       "fused_into IS NOT NULL)",
       "fusions", "in a circle"},
      {"ObserverOfNone", "UPDATE points SET observers = x'7f'" + one, "observers", "names observer 127"},
      {"EarlierObserver", "UPDATE point_history SET observers = x'7f'", "observers", "names observer 127"},
  };
}

std::vector<Case> TileCases() {
  const std::string in_fresh_tile =
      " WHERE point_id = (SELECT max(point_id) FROM points JOIN tiles t USING (tile_id) JOIN tile_blobs b USING "
      "(tile_id) WHERE b.revision = t.revision)";
  const std::string fresh = " WHERE revision = (SELECT revision FROM tiles t WHERE t.tile_id = tile_blobs.tile_id)";
  return {
      {"TileOfNoMap", "UPDATE tiles SET map_id = 999", "tiles", "of map 999"},
      {"TileToCome", "UPDATE tiles SET revision = 999999", "tiles", "revision 999999"},
      {"TileKey", "UPDATE tiles SET tile_key = -1 WHERE tile_id = 1", "tiles", "key -1 is none"},
      {"TileCounter", "UPDATE tiles SET num_points = 7 WHERE tile_id = 1", "tile_counts", "num_points is 7"},
      {"BlobOfNoTile", "UPDATE tile_blobs SET tile_id = tile_id + 900", "tile_blobs", "that does not exist"},
      {"BlobChecksum", "UPDATE tile_blobs SET blob = zeroblob(length(blob))", "tile_blobs", "blob: crc32c"},
      {"BlobOfNoFormat", "UPDATE tile_blobs SET (blob, crc32c) = (x'00', 1383945041)", "tile_blobs",
       "blob: tile: truncated"},
      {"BlobToCome", "UPDATE tile_blobs SET revision = 999999", "tile_blobs", "blob of revision 999999"},
      {"BlobOfAnotherRevision", "UPDATE tile_blobs SET revision = revision - 1", "tile_blobs", "blob is of tile"},
      {"BlobPosition", "UPDATE points SET x_m = x_m + 0.001" + in_fresh_tile, "tile_blobs", "has another position"},
      {"BlobDescriptor", "UPDATE points SET descriptor = zeroblob(32)" + in_fresh_tile, "tile_blobs",
       "has another descriptor"},
      {"BlobObservations", "UPDATE points SET num_observations = 999" + in_fresh_tile, "tile_blobs",
       "has another number of observations"},
      {"BlobPointMissing", "DELETE FROM points" + in_fresh_tile, "tile_blobs", "is not the tile's"},
      {"BlobPointTooMany",
       "UPDATE points SET tile_id = (SELECT tile_id FROM tile_blobs" + fresh +
           " LIMIT 1) WHERE point_id = (SELECT point_id FROM points WHERE tile_id IS NULL LIMIT 1)",
       "tile_blobs", "is missing"},
      {"FrameNotIndexed", "DELETE FROM frame_index WHERE frame_id = 2", "frame_index", "not in frame_index"},
      {"FrameIndexedForNothing", "INSERT INTO frame_index VALUES (900, 1, 1, 0, 0, 0, 0, 0, 0)", "frame_index",
       "not in the map"},
      {"FrameIndexedElsewhere", "UPDATE frame_index SET x_max_m = x_max_m + 1 WHERE frame_id = 2", "frame_index",
       "has it elsewhere"},
      {"FrameIndexedInAnotherMap", "UPDATE frame_index SET map_min = 0 WHERE frame_id = 2", "frame_index",
       "has it elsewhere"},
      {"TileNotIndexed", "DELETE FROM tile_index WHERE tile_id = 1", "tile_index", "not in tile_index"},
      {"TileIndexedForNothing", "INSERT INTO tile_index VALUES (900, 1, 1, 0, 8, 0, 8, 0, 8)", "tile_index",
       "in tile_index only"},
      {"TileIndexedElsewhere", "UPDATE tile_index SET z_min_m = z_min_m - 8 WHERE tile_id = 1", "tile_index",
       "has it elsewhere"},
  };
}

/// In one process a group: making the healthy database takes longer than a case.
void ExpectFound(const std::vector<Case>& cases) {
  for (const Case& test : cases) {
    SCOPED_TRACE(test.name);
    const DatabaseCopy copy;
    copy.RunSql(test.sql);
    const auto report = Verify(copy.file());
    ASSERT_TRUE(report.ok()) << report.status();
    EXPECT_TRUE(std::ranges::any_of(report->violations, [&test](const Violation& violation) {
      return violation.check == test.check && violation.message.find(test.message) != std::string::npos;
    })) << Describe(*report);
    for (const Violation& violation : report->violations) {
      EXPECT_EQ(violation.message.find('\n'), std::string::npos);
      EXPECT_FALSE(violation.what.empty());
    }
  }
}

TEST(ViolationsTest, OfTheFileAreFound) { ExpectFound(FileCases()); }
TEST(ViolationsTest, OfMapsAndSessionsAreFound) { ExpectFound(CatalogCases()); }
TEST(ViolationsTest, OfFramesAreFound) { ExpectFound(FrameCases()); }
TEST(ViolationsTest, OfPointsAreFound) { ExpectFound(PointCases()); }
TEST(ViolationsTest, OfTilesAreFound) { ExpectFound(TileCases()); }
TEST(ViolationsTest, OfChangesAreFound) { ExpectFound(ChangeCases()); }

}  // namespace
}  // namespace mapp::testing
