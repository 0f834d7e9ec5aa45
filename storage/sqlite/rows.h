#pragma once

#include "mapp/base/status.h"
#include "storage/records.h"
#include "storage/sqlite/statement.h"

// Column lists and the functions that read rows selected with them. String literals, because SQL texts are put
// together from them at compile time.

#define MAPP_MAP_COLUMNS                                                                                        \
  "map_id, name, created_ns, revision, tile_edge_m, cone_range_m, founder_session_id, num_frames, num_points, " \
  "num_sessions, feature_descriptor, feature_scale_factor, feature_num_levels, feature_patch_size_px, "         \
  "has_metric_scale, oldest_revision"
#define MAPP_SESSION_COLUMNS                                                                   \
  "session_id, map_id, device, camera_id, sensor, opened_ns, closed_ns, aligned_at_keyframe, " \
  "optimized_revision, num_keyframes, num_upload_bytes, tx_m, ty_m, tz_m, qw, qx, qy, qz, "    \
  "quarantined_ns, quarantine_reason, quarantine_released_ns, scale_map_session"
#define MAPP_CAMERA_COLUMNS "camera_id, model, coefficients, width_px, height_px, stereo_baseline_m"
#define MAPP_FRAME_COLUMNS                                                                                        \
  "frame_id, map_id, session_id, camera_id, number, stamp_ns, partial, overlap, num_features, num_packet_bytes, " \
  "created_revision, in_map, tx_m, ty_m, tz_m, qw, qx, qy, qz"
/// Of points (`p`). Versions in point_history have the same columns.
#define MAPP_POINT_COLUMNS                                                                          \
  "p.point_id, p.session_id, p.session_point, p.tile_id, p.created_revision, p.x_m, p.y_m, p.z_m, " \
  "p.view_direction, p.descriptor, p.reference_distance_m, p.num_observations, p.confidence, p.observers"
#define MAPP_CHANGE_COLUMNS                                                                                        \
  "change_id, map_id, kind, status, confidence, after_ns, before_ns, first_seen_ns, last_seen_ns, "                \
  "detected_revision, applied_revision, sessions, points_before, points_after, "                                   \
  "before_tx_m, before_ty_m, before_tz_m, before_qw, before_qx, before_qy, before_qz, before_size_x_m, "           \
  "before_size_y_m, before_size_z_m, after_tx_m, after_ty_m, after_tz_m, after_qw, after_qx, after_qy, after_qz, " \
  "after_size_x_m, after_size_y_m, after_size_z_m"

namespace mapp::sqlite {

// Each gives DATA_LOSS naming the row when a stored value is impossible.
StatusOr<MapRecord> ReadMap(const Statement& row);
StatusOr<SessionRecord> ReadSession(const Statement& row);
StatusOr<CameraRecord> ReadCamera(const Statement& row);
StatusOr<FrameRecord> ReadFrame(const Statement& row);
StatusOr<PointRecord> ReadPoint(const Statement& row);
StatusOr<ChangeRecord> ReadChange(const Statement& row);

/// tx, ty, tz, qw, qx, qy, qz from `first_column` on.
Pose3 ReadPose(const Statement& row, int first_column);
/// Binds them in that order.
void BindPose(Statement& statement, const Pose3& pose);
/// Of a box: its pose, then its size.
constexpr int kBoxColumns = 7 + 3;

/// Reads all rows with `read`, one of the functions above.
template <typename Record>
StatusOr<std::vector<Record>> ReadAll(Statement& statement, StatusOr<Record> (*read)(const Statement&)) {
  std::vector<Record> records;
  for (;;) {
    MAPP_ASSIGN_OR_RETURN(const bool has_row, statement.Step());
    if (!has_row) return records;
    MAPP_ASSIGN_OR_RETURN(Record record, read(statement));
    records.push_back(std::move(record));
  }
}

}  // namespace mapp::sqlite
