#include "change_scene.h"

#include "api/convert/convert.h"
#include "fake_admin_service.h"
#include "mapp/base/rng.h"

#include <cmath>

namespace mapp {
namespace {

constexpr int64_t kHourNs = 3'600'000'000'000;
constexpr int64_t kMorningNs = 1'795'420'800'000'000'000;  // 2026-11-23 08:00:00 UTC

OrientedBox CrateAt(double x_m, double z_m, double yaw_deg, const Eigen::Vector3d& size_m) {
  const Eigen::Quaterniond R_map_box(Eigen::AngleAxisd(yaw_deg * M_PI / 180, Eigen::Vector3d::UnitY()));
  return {.T_frame_box = {R_map_box, {x_m, -size_m.y() / 2, z_m}}, .size_m = size_m};
}

/// Points within the box with the ids first_id, first_id + 1, ...; tells their ids.
std::vector<uint64_t> Fill(const OrientedBox& box_map, uint64_t first_id, uint64_t num_points, Rng& rng,
                           std::vector<MapPointSummary>& points) {
  std::vector<uint64_t> ids;
  for (uint64_t i = 0; i < num_points; ++i) {
    const Eigen::Vector3d side(rng.Uniform(-0.5, 0.5), rng.Uniform(-0.5, 0.5), rng.Uniform(-0.5, 0.5));
    const Eigen::Vector3d p_map = box_map.T_frame_box * side.cwiseProduct(box_map.size_m);
    points.push_back({p_map, 4, 0.8F, 1, first_id + i});
    ids.push_back(first_id + i);
  }
  return ids;
}

ChangeSummary MakeChange(uint64_t id, ChangeKind kind, ChangeStatus status, double confidence) {
  ChangeSummary change;
  change.id = id;
  change.kind = kind;
  change.status = status;
  change.confidence = confidence;
  change.after_unix_ns = kMorningNs;
  change.before_unix_ns = kMorningNs + 3 * kHourNs;
  change.first_seen_unix_ns = kMorningNs - 24 * kHourNs;
  change.last_seen_unix_ns = kMorningNs;
  change.session_ids = {1, 2, 5};
  change.detected_revision = 39;
  return change;
}

v1::OrientedBox ToWire(const OrientedBox& box_map) {
  v1::OrientedBox proto;
  *proto.mutable_pose() = ToProto(box_map.T_frame_box);
  proto.set_size_x_m(box_map.size_m.x());
  proto.set_size_y_m(box_map.size_m.y());
  proto.set_size_z_m(box_map.size_m.z());
  return proto;
}

v1::Change ToWire(const ChangeSummary& change) {
  v1::Change proto;
  proto.set_id(change.id);
  proto.set_kind(static_cast<v1::ChangeKind>(change.kind));
  proto.set_status(static_cast<v1::ChangeStatus>(change.status));
  proto.set_confidence(change.confidence);
  proto.set_after_unix_ns(change.after_unix_ns);
  proto.set_before_unix_ns(change.before_unix_ns);
  proto.set_first_seen_unix_ns(change.first_seen_unix_ns);
  proto.set_last_seen_unix_ns(change.last_seen_unix_ns);
  for (const uint64_t id : change.session_ids) proto.add_session_ids(static_cast<uint32_t>(id));
  if (change.box_map_before) *proto.mutable_box_before() = ToWire(*change.box_map_before);
  if (change.box_map_after) *proto.mutable_box_after() = ToWire(*change.box_map_after);
  proto.mutable_points_before()->Add(change.points_before.begin(), change.points_before.end());
  proto.mutable_points_after()->Add(change.points_after.begin(), change.points_after.end());
  proto.set_detected_revision(change.detected_revision);
  proto.set_applied_revision(change.applied_revision);
  return proto;
}

v1::ExportMapResponse ToWire(const MapContent& content) {
  v1::ExportMapResponse proto;
  proto.mutable_map()->set_name(content.map.name);
  proto.mutable_map()->set_revision(content.map.revision);
  for (const MapFrameSummary& frame : content.frames) {
    v1::ExportedFrame& exported = *proto.add_frames();
    exported.set_session_id(static_cast<uint32_t>(frame.session_id));
    exported.set_keyframe(frame.keyframe);
    *exported.mutable_pose_map_camera() = ToProto(frame.T_map_camera);
  }
  for (const MapPointSummary& point : content.points) {
    v1::ExportedPoint& exported = *proto.add_points();
    exported.set_id(point.id);
    *exported.mutable_position_map() = ToProto(point.p_map);
    exported.set_num_observations(point.num_observations);
    exported.set_confidence(point.confidence);
    exported.set_session_id(static_cast<uint32_t>(point.session_id));
  }
  return proto;
}

}  // namespace

ChangeScene::ChangeScene() {
  Rng rng(1);
  for (uint64_t i = 0; i < 4000; ++i) {
    const double along = rng.Uniform(0, 1);
    const double height = rng.Uniform(-2.5, 0);
    const Eigen::Vector3d walls[] = {
        {8 * along, height, 0}, {8 * along, height, 6}, {0, height, 6 * along}, {8, height, 6 * along}};
    now.points.push_back({walls[i % 4], 3, 0.9F, 1, i + 1});
  }
  for (uint32_t i = 0; i < 24; ++i) {
    const double angle = 2 * M_PI * i / 24;
    const Eigen::Quaterniond R_map_camera(Eigen::AngleAxisd(-angle, Eigen::Vector3d::UnitY()));
    now.frames.push_back({1, i, int64_t{i}, Pose3(R_map_camera, {4 + 2.5 * std::cos(angle), -1.3, 3 + std::sin(angle)}),
                          /*partial=*/false});
  }
  now.map.name = "garage";
  now.map.revision = 42;

  ChangeSummary vanished = MakeChange(1, ChangeKind::kVanished, ChangeStatus::kProposed, 0.97);
  vanished.box_map_before = CrateAt(2, 2, 30, {0.9, 0.8, 0.6});
  vanished.points_before = Fill(*vanished.box_map_before, 5001, 60, rng, now.points);

  ChangeSummary appeared = MakeChange(2, ChangeKind::kAppeared, ChangeStatus::kProposed, 0.885);
  appeared.box_map_after = CrateAt(6, 4.5, -60, {1.1, 0.5, 0.5});
  appeared.points_after = Fill(*appeared.box_map_after, 5101, 60, rng, now.points);

  ChangeSummary moved = MakeChange(3, ChangeKind::kMoved, ChangeStatus::kProposed, 0.91);
  moved.box_map_before = CrateAt(1.5, 4.6, 15, {0.7, 1.0, 0.5});
  moved.box_map_after = CrateAt(4.2, 3.2, 70, {0.7, 1.0, 0.5});
  moved.points_before = Fill(*moved.box_map_before, 5201, 40, rng, now.points);
  moved.points_after = Fill(*moved.box_map_after, 5301, 40, rng, now.points);

  then = now;
  then.map.revision = 40;
  ChangeSummary accepted = MakeChange(12, ChangeKind::kVanished, ChangeStatus::kAccepted, 0.99);
  accepted.box_map_before = CrateAt(6.4, 1.3, 45, {0.8, 0.8, 0.8});
  accepted.points_before = Fill(*accepted.box_map_before, 5401, 40, rng, then.points);
  accepted.applied_revision = 41;

  ChangeSummary rejected = MakeChange(13, ChangeKind::kAppeared, ChangeStatus::kRejected, 0.6);
  rejected.box_map_after = CrateAt(4, 5, 0, {0.5, 0.5, 0.5});
  rejected.points_after = Fill(*rejected.box_map_after, 5501, 20, rng, now.points);

  changes = {vanished, appeared, moved, accepted, rejected};
}

ChangedMap ChangeScene::ToChangedMap() const {
  ChangedMap map;
  map.now = now;
  map.changes.assign(changes.begin(), changes.end() - 1);
  map.retired.assign(then.points.end() - 40, then.points.end());
  map.points_then = then.points;
  return map;
}

std::unique_ptr<FakeAdminService> ChangeScene::Serve() const {
  auto service = std::make_unique<FakeAdminService>();
  service->now = ToWire(now);
  service->at["40"] = ToWire(then);
  for (const ChangeSummary& change : changes) service->changes.push_back(ToWire(change));
  return service;
}

}  // namespace mapp
