// Keyframe log, frames, their poses and observations.

#include "mapp/base/bytes.h"
#include "mapp/codec/keyframe_codec.h"
#include "storage/sqlite/blobs.h"
#include "storage/sqlite/verify_check.h"
#include "storage/sqlite/verify_sql.h"

#include <absl/strings/str_cat.h>
#include <fmt/format.h>

#include <cmath>
#include <memory>
#include <optional>
#include <unordered_set>
#include <vector>

namespace mapp::sqlite {
namespace {

constexpr const char* kLog = R"sql(
SELECT l.frame_id, 'is in the keyframe log and in no row of frames'
  FROM keyframe_log l LEFT JOIN frames f USING (frame_id) WHERE f.frame_id IS NULL
)sql";

constexpr const char* kPackets = R"sql(
SELECT l.frame_id, l.packet, l.crc32c, f.session_id, f.number, f.stamp_ns, f.partial, f.overlap, f.num_features
  FROM keyframe_log l JOIN frames f USING (frame_id)
)sql";

StatusOr<std::string> PacketFault(Connection& /*db*/, const Statement& row) {
  const std::string_view packet = row.Bytes(1);
  if (const uint32_t crc = Crc32c(packet); crc != row.Int64(2)) {
    return fmt::format("packet: crc32c {:#010x} != stored {:#010x}", crc, row.Int64(2));
  }
  const StatusOr<Keyframe> keyframe = DecodeKeyframe(packet);
  if (!keyframe.ok()) return absl::StrCat("packet: ", keyframe.status().message());
  std::string found;
  const auto differ = [&found](const char* name, auto in_packet, auto in_row) {
    if (in_packet != in_row) found += fmt::format("packet says {} {}, its row {}\n", name, in_packet, in_row);
  };
  differ("session", keyframe->session.value(), static_cast<uint64_t>(row.Int64(3)));
  differ("number", int64_t{keyframe->number}, row.Int64(4));
  differ("stamp_ns", keyframe->stamp_ns, row.Int64(5));
  differ("partial", static_cast<int64_t>(keyframe->partial), row.Int64(6));
  // No overlap is none that a device can report.
  differ("overlap", double{keyframe->overlap.value_or(-1.0F)}, row.IsNull(7) ? -1.0 : row.Double(7));
  differ("num_features", static_cast<int64_t>(keyframe->features.size()), row.Int64(8));
  return found;
}

constexpr const char* kFrames = R"sql(
SELECT f.frame_id, 'is keyframe ' || f.number || ' of session ' || f.session_id || ', in the log ' || l.number || ' of '
       || l.session_id
  FROM frames f JOIN keyframe_log l USING (frame_id) WHERE l.session_id <> f.session_id OR l.number <> f.number
UNION ALL
SELECT f.frame_id, format('num_packet_bytes is %d, and the packet has %d', f.num_packet_bytes, length(l.packet))
  FROM frames f JOIN keyframe_log l USING (frame_id) WHERE f.num_packet_bytes <> length(l.packet)
UNION ALL
SELECT f.frame_id, format('map %d and camera %d are not those of session %d', f.map_id, f.camera_id, f.session_id)
  FROM frames f LEFT JOIN sessions s USING (session_id) WHERE s.map_id IS NOT f.map_id OR s.camera_id IS NOT f.camera_id
UNION ALL
SELECT f.frame_id, format('made at revision %d, with the pose of %d: the map is at %d', f.created_revision,
                          f.pose_revision, m.revision)
  FROM frames f JOIN maps m USING (map_id)
 WHERE NOT (1 <= f.created_revision AND f.created_revision <= f.pose_revision AND f.pose_revision <= m.revision)
UNION ALL
SELECT frame_id, 'in_map or partial is neither 0 nor 1' FROM frames
 WHERE in_map NOT IN (0, 1) OR partial NOT IN (0, 1)
)sql";

constexpr const char* kPoses =
    "SELECT frame_id, 'pose is not finite or its quaternion no unit one' FROM frames WHERE NOT " MAPP_SQL_IS_POSE
    " UNION ALL SELECT frame_id, format('pose of revision %d is not finite or its quaternion no unit one', "
    "created_revision) FROM frame_pose_history WHERE NOT " MAPP_SQL_IS_POSE;

// Versions of a frame begin with the frame, and end before the live one begins.
constexpr const char* kPoseHistory = R"sql(
SELECT h.frame_id, format('pose of revisions %d to %d: the frame is of %d, its live pose of %d', h.created_revision,
                          h.retired_revision, f.created_revision, f.pose_revision)
  FROM frame_pose_history h LEFT JOIN frames f USING (frame_id)
 WHERE f.frame_id IS NULL OR h.created_revision >= h.retired_revision OR h.created_revision < f.created_revision
    OR h.retired_revision > f.pose_revision
UNION ALL
SELECT h.frame_id, format('poses of revisions %d and %d overlap', h.created_revision, n.created_revision)
  FROM frame_pose_history h JOIN frame_pose_history n ON n.frame_id = h.frame_id
                            AND n.created_revision > h.created_revision AND n.created_revision < h.retired_revision
)sql";

constexpr const char* kObservationRows = R"sql(
SELECT f.frame_id, 'has no row in frame_observations'
  FROM frames f LEFT JOIN frame_observations o USING (frame_id) WHERE o.frame_id IS NULL
UNION ALL
SELECT o.frame_id, format('observations of revision %d: the frame is of %d, the map at %d', o.created_revision,
                          f.created_revision, m.revision)
  FROM frame_observations o JOIN frames f USING (frame_id) JOIN maps m USING (map_id)
 WHERE o.created_revision NOT BETWEEN f.created_revision AND m.revision
)sql";

constexpr const char* kObservationHistory = R"sql(
SELECT h.frame_id, format('observations of revisions %d to %d: the frame is of %s, the live ones of %s',
                          h.created_revision, h.retired_revision, coalesce(f.created_revision, 'none'),
                          coalesce(o.created_revision, 'none'))
  FROM frame_observation_history h LEFT JOIN frames f USING (frame_id) LEFT JOIN frame_observations o USING (frame_id)
 WHERE o.frame_id IS NULL OR f.frame_id IS NULL OR h.created_revision >= h.retired_revision
    OR h.created_revision < f.created_revision OR h.retired_revision > o.created_revision
UNION ALL
SELECT h.frame_id, format('observations of revisions %d and %d overlap', h.created_revision, n.created_revision)
  FROM frame_observation_history h
       JOIN frame_observation_history n ON n.frame_id = h.frame_id AND n.created_revision > h.created_revision
                                       AND n.created_revision < h.retired_revision
)sql";

// A frame that has left the map, or a point that was retired since, may be named: history keeps both.
constexpr const char* kMapOfPoint = R"sql(
SELECT s.map_id FROM (SELECT session_id FROM points WHERE point_id = ?1
                      UNION ALL SELECT session_id FROM point_history WHERE point_id = ?1 LIMIT 1)
  JOIN sessions s USING (session_id)
)sql";

/// The maps that points are or were in. Frames that follow each other observe the same points: what was asked last is
/// kept, about a megabyte.
class MapsOfPoints {
 public:
  /// nullopt: there never was such a point.
  StatusOr<std::optional<int64_t>> Find(Connection& db, MapPointId point) {
    Entry& entry = entries_[point.value() % entries_.size()];
    if (entry.point == point) return entry.map;
    Statement query = db.Prepare(kMapOfPoint);
    MAPP_ASSIGN_OR_RETURN(const bool has_row, query.Bind(point).Step());
    if (!has_row) return std::optional<int64_t>();
    entry = {point, query.Int64(0)};
    return std::optional(entry.map);
  }

 private:
  struct Entry {
    std::optional<MapPointId> point;
    int64_t map = 0;
  };
  std::vector<Entry> entries_ = std::vector<Entry>(1 << 15);
};

/// Columns: frame, observations, number of the frame's features, map, whether history of it has been dropped.
StatusOr<std::string> ObservationFault(MapsOfPoints& maps, Connection& db, const Statement& row) {
  const StatusOr<std::vector<Observation>> observations = DecodeObservations(row.Bytes(1));
  if (!observations.ok()) return std::string(observations.status().message());
  std::string found;
  std::unordered_set<uint16_t> features;
  std::unordered_set<uint64_t> points;
  for (const Observation& seen : *observations) {
    if (seen.feature_idx >= row.Int64(2)) {
      found += fmt::format("observes with feature {} of {}\n", seen.feature_idx, row.Int64(2));
    }
    if (!features.insert(seen.feature_idx).second)
      found += fmt::format("feature {} observes twice\n", seen.feature_idx);
    if (!points.insert(seen.point.value()).second)
      found += fmt::format("observes point {} twice\n", seen.point.value());
    if (!(seen.depth_m >= 0 && std::isfinite(seen.depth_m))) {
      found += fmt::format("observes point {} at depth {} m\n", seen.point.value(), seen.depth_m);
    }
    MAPP_ASSIGN_OR_RETURN(const std::optional<int64_t> map, maps.Find(db, seen.point));
    const bool may_be_dropped = row.Int64(4) != 0 && !map;
    if (map != row.Int64(3) && !may_be_dropped) {
      found += fmt::format("observes point {}, which the map never had\n", seen.point.value());
    }
  }
  return found;
}

}  // namespace

std::vector<VerifyCheck> FrameChecks() {
  const auto observation_fault = [maps = std::make_shared<MapsOfPoints>()](Connection& db, const Statement& row) {
    return ObservationFault(*maps, db, row);
  };
  return {
      {.name = "keyframe_log", .what = "frame", .sql = kLog},
      {.name = "packets", .what = "frame", .sql = kPackets, .fault = PacketFault},
      {.name = "frames", .what = "frame", .sql = kFrames},
      {.name = "poses", .what = "frame", .sql = kPoses},
      {.name = "pose_history", .what = "frame", .sql = kPoseHistory},
      {.name = "observations", .what = "frame", .sql = kObservationRows},
      {.name = "observations",
       .what = "frame",
       .sql = "SELECT o.frame_id, o.observations, f.num_features, f.map_id, m.oldest_revision > 0 FROM "
              "frame_observations o JOIN frames f USING (frame_id) JOIN maps m USING (map_id)",
       .fault = observation_fault},
      {.name = "observation_history", .what = "frame", .sql = kObservationHistory},
      {.name = "observation_history",
       .what = "frame",
       .sql = "SELECT o.frame_id, o.observations, f.num_features, f.map_id, m.oldest_revision > 0 FROM "
              "frame_observation_history o JOIN frames f USING (frame_id) JOIN maps m USING (map_id)",
       .fault = observation_fault},
  };
}

}  // namespace mapp::sqlite
