#include "storage/sqlite/as_of.h"

#include "storage/sqlite/revisions.h"

#include <fmt/format.h>

namespace mapp::sqlite {
namespace {

// {0} is the map, {1} the revision: a view takes no parameters. Tables are named with their schema throughout, a bare
// name would mean the view.
constexpr const char* kViews = R"sql(
CREATE TEMP VIEW sessions AS
  WITH versions AS (
    SELECT session_id, closed_ns, aligned_at_keyframe, optimized_revision, tx_m, ty_m, tz_m, qw, qx, qy, qz,
           scale_map_session, quarantined_ns, quarantine_reason, quarantine_released_ns
      FROM main.sessions WHERE state_revision <= {1}
    UNION ALL
    SELECT session_id, closed_ns, aligned_at_keyframe, optimized_revision, tx_m, ty_m, tz_m, qw, qx, qy, qz,
           scale_map_session, quarantined_ns, quarantine_reason, quarantine_released_ns
      FROM main.session_history WHERE created_revision <= {1} AND {1} < retired_revision)
  SELECT s.session_id, s.map_id, s.device, s.camera_id, s.sensor, s.opened_ns, v.closed_ns, v.aligned_at_keyframe,
         v.optimized_revision, v.tx_m, v.ty_m, v.tz_m, v.qw, v.qx, v.qy, v.qz, v.scale_map_session, v.quarantined_ns,
         v.quarantine_reason, v.quarantine_released_ns,
         (SELECT count(*) FROM main.keyframe_log l JOIN main.frames f USING (frame_id)
           WHERE l.session_id = s.session_id AND f.created_revision <= {1}) AS num_keyframes,
         (SELECT coalesce(sum(f.num_packet_bytes), 0) FROM main.keyframe_log l JOIN main.frames f USING (frame_id)
           WHERE l.session_id = s.session_id AND f.created_revision <= {1}) AS num_upload_bytes
    FROM main.sessions s JOIN versions v USING (session_id) WHERE s.map_id = {0} AND s.opened_revision <= {1};

CREATE TEMP VIEW keyframe_log AS
  SELECT l.* FROM main.keyframe_log l JOIN main.frames f USING (frame_id)
   WHERE f.map_id = {0} AND f.created_revision <= {1};

CREATE TEMP VIEW frames AS
  SELECT frame_id, map_id, session_id, camera_id, number, stamp_ns, partial, overlap, num_features, num_packet_bytes,
         created_revision, pose_revision, in_map, tx_m, ty_m, tz_m, qw, qx, qy, qz
    FROM main.frames WHERE map_id = {0} AND pose_revision <= {1}
  UNION ALL
  SELECT f.frame_id, f.map_id, f.session_id, f.camera_id, f.number, f.stamp_ns, f.partial, f.overlap, f.num_features,
         f.num_packet_bytes, f.created_revision, h.created_revision, h.in_map, h.tx_m, h.ty_m, h.tz_m, h.qw, h.qx, h.qy,
         h.qz
    FROM main.frames f JOIN main.frame_pose_history h USING (frame_id)
   WHERE f.map_id = {0} AND h.created_revision <= {1} AND {1} < h.retired_revision;

CREATE TEMP VIEW frame_observations AS
  SELECT o.frame_id, o.created_revision, o.observations FROM main.frame_observations o JOIN main.frames f USING (frame_id)
   WHERE f.map_id = {0} AND o.created_revision <= {1}
  UNION ALL
  SELECT h.frame_id, h.created_revision, h.observations
    FROM main.frame_observation_history h JOIN main.frames f USING (frame_id)
   WHERE f.map_id = {0} AND h.created_revision <= {1} AND {1} < h.retired_revision;

CREATE TEMP VIEW frame_index AS
  SELECT frame_id, map_id AS map_min, map_id AS map_max, tx_m AS x_min_m, tx_m AS x_max_m, ty_m AS y_min_m,
         ty_m AS y_max_m, tz_m AS z_min_m, tz_m AS z_max_m FROM temp.frames WHERE in_map;

CREATE TEMP VIEW points AS
  SELECT point_id, session_id, session_point, tile_id, created_revision, x_m, y_m, z_m, view_direction, descriptor,
         reference_distance_m, num_observations, confidence, observers
    FROM main.points
   WHERE created_revision <= {1} AND session_id IN (SELECT session_id FROM main.sessions WHERE map_id = {0})
  UNION ALL
  SELECT point_id, session_id, session_point, tile_id, created_revision, x_m, y_m, z_m, view_direction, descriptor,
         reference_distance_m, num_observations, confidence, observers
    FROM main.point_history
   WHERE created_revision <= {1} AND {1} < retired_revision
     AND session_id IN (SELECT session_id FROM main.sessions WHERE map_id = {0});

-- What had ended by then: the way from a retired point to the one that stands for it.
CREATE TEMP VIEW point_history AS SELECT * FROM main.point_history WHERE retired_revision <= {1};

CREATE TEMP VIEW session_points AS
  SELECT s.* FROM main.session_points s
   WHERE EXISTS (SELECT 1 FROM main.points p WHERE p.point_id = s.point_id AND p.created_revision <= {1})
      OR EXISTS (SELECT 1 FROM main.point_history h WHERE h.point_id = s.point_id AND h.created_revision <= {1})
      -- One whose history has been dropped had ended before any revision that can still be read.
      OR NOT EXISTS (SELECT 1 FROM main.points p WHERE p.point_id = s.point_id
                     UNION ALL SELECT 1 FROM main.point_history h WHERE h.point_id = s.point_id);

-- The index of tiles has all that there ever were.
CREATE TEMP TABLE tile_counts (tile_id INTEGER PRIMARY KEY, num_points INTEGER NOT NULL);
INSERT INTO tile_counts SELECT tile_id, count(*) FROM temp.points WHERE tile_id IS NOT NULL GROUP BY tile_id;

CREATE TEMP VIEW tiles AS
  SELECT t.tile_id, t.map_id, t.tile_key, min(t.revision, {1}) AS revision, c.num_points
    FROM main.tiles t JOIN temp.tile_counts c USING (tile_id) WHERE t.map_id = {0};

CREATE TEMP VIEW tile_blobs AS
  SELECT b.* FROM main.tile_blobs b JOIN main.tiles t USING (tile_id) WHERE t.map_id = {0} AND t.revision <= {1};

CREATE TEMP VIEW place_blocks AS SELECT * FROM main.place_blocks WHERE map_id = {0};
CREATE TEMP VIEW evidence AS
  SELECT * FROM main.evidence WHERE session_id IN (SELECT session_id FROM main.sessions WHERE map_id = {0});
CREATE TEMP VIEW findings AS
  SELECT * FROM main.findings WHERE session_id IN (SELECT session_id FROM main.sessions WHERE map_id = {0});
CREATE TEMP VIEW changes AS SELECT * FROM main.changes WHERE map_id = {0};
CREATE TEMP VIEW revisions AS SELECT * FROM main.revisions WHERE map_id = {0} AND revision <= {1};
CREATE TEMP VIEW tags AS SELECT * FROM main.tags WHERE map_id = {0} AND revision <= {1};

CREATE TEMP VIEW maps AS
  WITH versions AS (
    SELECT founder_session_id, has_metric_scale FROM main.maps WHERE map_id = {0} AND state_revision <= {1}
    UNION ALL
    SELECT founder_session_id, has_metric_scale FROM main.map_history
     WHERE map_id = {0} AND created_revision <= {1} AND {1} < retired_revision)
  SELECT m.map_id, m.name, m.created_ns, {1} AS revision, m.tile_edge_m, m.cone_range_m, v.founder_session_id,
         (SELECT count(*) FROM temp.frames WHERE in_map) AS num_frames,
         (SELECT coalesce(sum(num_points), 0) FROM temp.tile_counts) AS num_points,
         (SELECT count(*) FROM temp.sessions) AS num_sessions,
         m.feature_descriptor, m.feature_scale_factor, m.feature_num_levels, m.feature_patch_size_px,
         v.has_metric_scale, m.oldest_revision
    FROM main.maps m JOIN versions v WHERE m.map_id = {0};
)sql";

}  // namespace

Status ShowAsOf(Connection& db, MapId map, Revision revision) {
  MAPP_RETURN_IF_ERROR(CheckRevision(db, map, revision));
  return db.Execute(fmt::format(fmt::runtime(kViews), map.value(), revision.value()));
}

}  // namespace mapp::sqlite
