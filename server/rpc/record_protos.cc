#include "server/rpc/record_protos.h"

#include "api/convert/convert.h"

namespace mapp {
namespace {

/// Of ExportedFrame::overlap, when the device never asked.
constexpr float kNoOverlap = -1;

}  // namespace

v1::MapInfo ToProto(const MapRecord& map) {
  v1::MapInfo info;
  info.set_id(map.id.value());
  info.set_name(map.name);
  info.set_created_unix_ns(map.created_ns);
  info.set_revision(map.revision.value());
  info.set_num_frames(static_cast<uint64_t>(map.num_frames));
  info.set_num_points(static_cast<uint64_t>(map.num_points));
  info.set_num_sessions(static_cast<uint64_t>(map.num_sessions));
  info.set_tile_edge_m(map.tile_edge_m);
  info.set_cone_range_m(map.cone_range_m);
  *info.mutable_feature_settings() = ToProto(map.features);
  info.set_scale_unknown(!map.has_metric_scale);
  return info;
}

v1::SessionInfo ToProto(const SessionRecord& session, const std::string& map_name) {
  v1::SessionInfo info;
  info.set_id(static_cast<uint32_t>(session.id.value()));
  info.set_map_id(session.map.value());
  info.set_map_name(map_name);
  info.set_device(session.device);
  info.set_sensor(ToProto(session.sensor));
  info.set_opened_unix_ns(session.opened_ns);
  info.set_closed_unix_ns(session.closed_ns.value_or(0));
  if (session.T_map_session) *info.mutable_pose_map_session() = ToProto(*session.T_map_session);
  info.set_scale_map_session(session.scale_map_session);
  info.set_aligned_at_keyframe(session.aligned_at_keyframe.value_or(0));
  info.set_num_keyframes(static_cast<uint64_t>(session.num_keyframes));
  info.set_num_upload_bytes(static_cast<uint64_t>(session.num_upload_bytes));
  if (session.quarantine) {
    v1::SessionInfo::Quarantine& quarantine = *info.mutable_quarantine();
    quarantine.set_since_unix_ns(session.quarantine->since_ns);
    quarantine.set_reason(session.quarantine->reason);
    quarantine.set_released_unix_ns(session.quarantine->released_ns.value_or(0));
  }
  return info;
}

v1::ExportedFrame ToProto(const FrameRecord& frame) {
  v1::ExportedFrame exported;
  exported.set_id(frame.id.value());
  exported.set_session_id(static_cast<uint32_t>(frame.session.value()));
  exported.set_keyframe(frame.number);
  exported.set_stamp_ns(frame.stamp_ns);
  *exported.mutable_pose_map_camera() = ToProto(frame.T_frame_camera);
  exported.set_partial(frame.partial);
  exported.set_overlap(frame.overlap.value_or(kNoOverlap));
  exported.set_num_features(frame.num_features);
  return exported;
}

v1::ExportedPoint ToProto(const PointRecord& point) {
  v1::ExportedPoint exported;
  exported.set_id(point.id.value());
  *exported.mutable_position_map() = ToProto(point.position);
  exported.set_num_observations(point.num_observations);
  exported.set_confidence(point.confidence);
  exported.set_session_id(static_cast<uint32_t>(point.session.value()));
  return exported;
}

v1::Change ToProto(const ChangeRecord& change) {
  v1::Change out;
  out.set_id(change.id.value());
  out.set_kind(static_cast<v1::ChangeKind>(change.kind));  // the same numbers
  out.set_status(static_cast<v1::ChangeStatus>(change.status));
  out.set_confidence(change.confidence);
  out.set_after_unix_ns(change.after_ns);
  out.set_before_unix_ns(change.before_ns);
  out.set_first_seen_unix_ns(change.first_seen_ns);
  out.set_last_seen_unix_ns(change.last_seen_ns);
  for (const SessionId session : change.sessions) out.add_session_ids(static_cast<uint32_t>(session.value()));
  if (change.box_before) *out.mutable_box_before() = ToProto(*change.box_before);
  if (change.box_after) *out.mutable_box_after() = ToProto(*change.box_after);
  for (const MapPointId point : change.points_before) out.add_points_before(point.value());
  for (const MapPointId point : change.points_after) out.add_points_after(point.value());
  out.set_detected_revision(change.detected.value());
  if (change.applied) out.set_applied_revision(change.applied->value());
  return out;
}

}  // namespace mapp
