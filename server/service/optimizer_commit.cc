#include "server/service/optimizer_commit.h"

#include <fmt/format.h>

#include <algorithm>
#include <map>
#include <set>
#include <unordered_map>

namespace mapp {
namespace {

/// Motions below these are noise: writing them would only fill the history.
constexpr double kMinFrameMotionM = 1e-4;
constexpr double kMinFrameTurnRad = 1e-5;
constexpr double kMinPointMotionM = 5e-4;

bool HasMoved(const Pose3& before, const Pose3& after) {
  return Distance(before, after) > kMinFrameMotionM || RotationAngle(before, after) > kMinFrameTurnRad;
}

}  // namespace

std::optional<SessionId> SoleSession(std::span<const FrameRecord> frames) {
  const auto of_first = [&frames](const FrameRecord& frame) { return frame.session == frames.front().session; };
  if (frames.empty() || !std::ranges::all_of(frames, of_first)) return std::nullopt;
  return frames.front().session;
}

Pose3 OptimizerCommit::MotionOf(int frame_idx) const {
  return adjusted_.frames[frame_idx].T_world_camera * region_.problem.frames[frame_idx].T_world_camera.Inverse();
}

Status OptimizerCommit::CheckUnchanged(MapWriter& writer) const {
  for (const FrameRecord& frame : region_.frames) {
    MAPP_ASSIGN_OR_RETURN(const FrameRecord now, writer.GetFrame(frame.id));
    if (!now.in_map || HasMoved(frame.T_frame_camera, now.T_frame_camera)) {
      return absl::AbortedError(fmt::format("frame {} changed while its region was optimised", frame.id.value()));
    }
  }
  return absl::OkStatus();
}

Status OptimizerCommit::MoveFrames(MapWriter& writer) {
  for (size_t i = 0; i < region_.frames.size(); ++i) {
    const Pose3& T_map_camera = adjusted_.frames[i].T_world_camera;
    if (!HasMoved(region_.frames[i].T_frame_camera, T_map_camera)) continue;
    MAPP_RETURN_IF_ERROR(writer.SetFramePose(region_.frames[i].id, /*in_map=*/true, T_map_camera));
  }
  for (const OptimizerRegion::CarriedFrame& carried : region_.carried_frames) {
    const Pose3 T_map_camera = MotionOf(carried.reference_idx) * carried.record.T_frame_camera;
    if (!HasMoved(carried.record.T_frame_camera, T_map_camera)) continue;
    MAPP_RETURN_IF_ERROR(writer.SetFramePose(carried.record.id, /*in_map=*/true, T_map_camera));
  }
  return absl::OkStatus();
}

std::vector<OptimizerCommit::Motion> OptimizerCommit::PointMotions() const {
  std::unordered_map<FrameId, int> references;
  for (size_t i = 0; i < region_.frames.size(); ++i) references.emplace(region_.frames[i].id, static_cast<int>(i));
  for (const OptimizerRegion::CarriedFrame& carried : region_.carried_frames) {
    references.emplace(carried.record.id, carried.reference_idx);
  }
  std::vector<Motion> motions;
  for (size_t i = 0; i < region_.points.size(); ++i) {
    motions.push_back({.point = region_.points[i].id, .position = adjusted_.points[i].p_world});
  }
  for (const OptimizerRegion::CarriedPoint& carried : region_.carried_points) {
    const Pose3 T_new_old = MotionOf(references.at(carried.frame));
    motions.push_back(
        {.point = carried.record.id, .position = T_new_old * carried.record.position, .turn = T_new_old.rotation()});
  }
  return motions;
}

Status OptimizerCommit::CarryArrived(MapWriter& writer, std::vector<Motion>& motions) {
  std::vector<FrameRecord> present;
  if (!region_.box_map.isEmpty()) {
    MAPP_ASSIGN_OR_RETURN(present, writer.FramesInBox(map(), region_.box_map));
  }
  for (const SessionId session : region_.led_sessions) {
    MAPP_ASSIGN_OR_RETURN(const std::vector<FrameRecord> frames, writer.ListFrames(map(), session));
    present.insert(present.end(), frames.begin(), frames.end());
  }
  std::set<MapPointId> carried;
  std::unordered_set<FrameId> moved;
  for (const FrameRecord& frame : present) {
    if (!frame.in_map || region_.known_frames.contains(frame.id) || !moved.insert(frame.id).second) continue;
    const Pose3 T_new_old = MotionOf(region_.ReferenceOf(frame));
    MAPP_RETURN_IF_ERROR(writer.SetFramePose(frame.id, /*in_map=*/true, T_new_old * frame.T_frame_camera));
    MAPP_ASSIGN_OR_RETURN(const std::vector<Observation> observations, writer.GetObservations(frame.id));
    std::vector<MapPointId> fresh;
    for (const Observation& observation : observations) {
      if (region_.known_points.contains(observation.point)) continue;
      if (carried.insert(observation.point).second) fresh.push_back(observation.point);
    }
    MAPP_ASSIGN_OR_RETURN(const std::vector<PointRecord> points, writer.FindPoints(fresh));
    for (const PointRecord& point : points) {
      // Older points that only frames outside the region knew stay with those frames.
      if (point.session == frame.session)
        motions.push_back({.point = point.id, .position = T_new_old * point.position, .turn = T_new_old.rotation()});
    }
  }
  return absl::OkStatus();
}

Status OptimizerCommit::MovePoints(MapWriter& writer, const std::vector<Motion>& motions) {
  MAPP_ASSIGN_OR_RETURN(const MapRecord map_record, writer.GetMap(map()));
  const TileGrid grid{.edge_m = map_record.tile_edge_m};
  std::unordered_map<MapPointId, const Motion*> targets;
  std::vector<MapPointId> ids;
  for (const Motion& motion : motions) {
    if (targets.emplace(motion.point, &motion).second) ids.push_back(motion.point);
  }
  // The current versions: what other sessions observed meanwhile stays, and points retired meanwhile stay retired.
  MAPP_ASSIGN_OR_RETURN(std::vector<PointRecord> points, writer.FindPoints(ids));
  std::set<TileKey> touched;
  for (PointRecord& point : points) {
    const Motion& motion = *targets.at(point.id);
    const Eigen::Vector3d& position = motion.position;
    if ((position - point.position).norm() < kMinPointMotionM || !position.allFinite()) continue;
    touched.insert(grid.KeyOf(point.position));
    point.position = position;
    point.view_direction = (motion.turn * point.view_direction.cast<double>()).cast<float>();
    touched.insert(grid.KeyOf(point.position));
    MAPP_RETURN_IF_ERROR(writer.UpdatePoint(point));
  }
  touched_tiles_.assign(touched.begin(), touched.end());
  return absl::OkStatus();
}

Status OptimizerCommit::DropOutliersOfFrame(MapWriter& writer, FrameId frame,
                                            const std::vector<Observation>& dropped) const {
  MAPP_ASSIGN_OR_RETURN(std::vector<Observation> observations, writer.GetObservations(frame));
  std::erase_if(observations, [&dropped](const Observation& observation) {
    return std::any_of(dropped.begin(), dropped.end(), [&observation](const Observation& wrong) {
      return wrong.point == observation.point && wrong.feature_idx == observation.feature_idx;
    });
  });
  return writer.SetObservations(frame, observations);
}

Status OptimizerCommit::DropOutliers(MapWriter& writer) const {
  // A point keeps its last observations: without any, nothing would say where it was seen from.
  std::vector<int> num_good(region_.points.size(), 0);
  for (size_t i = 0; i < outliers_.size(); ++i) {
    if (!outliers_[i]) ++num_good[region_.problem.observations[i].point_idx];
  }
  std::map<FrameId, std::vector<Observation>> dropped;
  for (size_t i = 0; i < outliers_.size(); ++i) {
    const BundleProblem::Observation& observation = region_.problem.observations[i];
    if (!outliers_[i] || num_good[observation.point_idx] == 0) continue;
    dropped[region_.frames[observation.frame_idx].id].push_back(region_.observations[i]);
  }
  for (const auto& [frame, observations] : dropped) {
    MAPP_RETURN_IF_ERROR(DropOutliersOfFrame(writer, frame, observations));
  }
  return absl::OkStatus();
}

Status OptimizerCommit::Run(MapWriter& writer) {
  MAPP_RETURN_IF_ERROR(CheckUnchanged(writer));
  MAPP_ASSIGN_OR_RETURN(revision_, writer.NextRevision(map()));
  std::vector<Motion> motions = PointMotions();
  MAPP_RETURN_IF_ERROR(CarryArrived(writer, motions));
  MAPP_RETURN_IF_ERROR(MoveFrames(writer));
  MAPP_RETURN_IF_ERROR(MovePoints(writer, motions));
  return DropOutliers(writer);
}

}  // namespace mapp
