#include "server/service/merger.h"

#include "server/service/alignment_projection.h"
#include "server/service/map_scale.h"
#include "server/service/point_stats.h"
#include "server/service/session_view.h"
#include "server/service/tile_cache.h"

#include <fmt/format.h>

#include <algorithm>
#include <map>
#include <set>
#include <unordered_set>

namespace mapp {
namespace {

using FusionVotes = std::map<MapPointId, std::map<MapPointId, int>>;

/// Pairs one keyframe's points with the map's.
Status VoteForFusions(MapReader& reader, const FrameRecord& frame, const Sim3& S_map_session, FusionVotes& votes) {
  MAPP_ASSIGN_OR_RETURN(const FrameView view, LoadFrame(reader, frame.id));
  const Pose3 T_map_camera = S_map_session * frame.T_frame_camera;
  MAPP_ASSIGN_OR_RETURN(const std::vector<PointRecord> points,
                        PointsSeenNear(reader, frame.map, {.session = frame.session}, T_map_camera));
  const std::optional<ProjectionAlignment> alignment =
      AlignByProjection(QueryKeyframe(view).AtScale(S_map_session.scale), points, T_map_camera);
  if (!alignment) return absl::OkStatus();
  for (const AlignmentMatch& match : alignment->inliers) {
    const std::optional<MapPointId>& own = view.points[match.feature_idx];
    if (own) ++votes[*own][match.point];
  }
  return absl::OkStatus();
}

/// The merge of one fragment, as a change to the store.
class FragmentMerge {
 public:
  FragmentMerge(SessionId session, const Placement& placement, const PointFusions& fusions)
      : session_(session), S_map_session_(placement.S_map_session), map_unit_(placement.map_unit), fusions_(fusions) {}

  Status Run(MapWriter& writer);

  bool merged() const { return merged_; }
  MapId map() const { return map_; }
  Revision revision() const { return revision_; }
  uint32_t newest_keyframe() const { return newest_keyframe_; }
  /// As it was entered: in the map's new unit if the map was rescaled for it.
  const Sim3& S_map_session() const { return S_map_session_; }
  const std::optional<RescaledMap>& rescaled() const { return rescaled_; }
  std::vector<TileKey> touched_tiles() const { return {tiles_.begin(), tiles_.end()}; }

 private:
  /// Gives the map the session's scale where it has none and the session has metres.
  Status SetScale(MapWriter& writer, const SessionRecord& session);
  Status LoadTargets(MapWriter& writer);
  Status MoveFrame(MapWriter& writer, const FrameRecord& frame);
  Status ObserveTarget(MapWriter& writer, const FrameView& view, int feature_idx, PointRecord& target);
  StatusOr<std::vector<Eigen::Vector3d>> ObserverCenters(MapWriter& writer, const PointRecord& point);
  Status MovePoints(MapWriter& writer);
  /// The map point that `point` becomes, or nullptr when it stays itself.
  PointRecord* TargetOf(MapPointId point);

  const SessionId session_;
  Sim3 S_map_session_;
  const double map_unit_;
  const PointFusions& fusions_;
  TileGrid grid_;
  std::unordered_map<MapPointId, PointRecord> targets_;
  std::unordered_map<FrameId, Eigen::Vector3d> centers_;
  std::set<TileKey> tiles_;
  MapId map_;
  Revision revision_;
  uint32_t newest_keyframe_ = 0;
  std::optional<RescaledMap> rescaled_;
  bool merged_ = false;
};

PointRecord* FragmentMerge::TargetOf(MapPointId point) {
  const auto fusion = fusions_.find(point);
  if (fusion == fusions_.end()) return nullptr;
  const auto target = targets_.find(fusion->second);
  return target == targets_.end() ? nullptr : &target->second;
}

/// The map may have changed since the fusions were found: targets retired meanwhile are left out.
Status FragmentMerge::LoadTargets(MapWriter& writer) {
  std::set<MapPointId> ids;
  for (const auto& [own, target] : fusions_) ids.insert(target);
  const std::vector<MapPointId> ordered(ids.begin(), ids.end());
  MAPP_ASSIGN_OR_RETURN(const std::vector<PointRecord> points, writer.FindPoints(ordered));
  for (const PointRecord& point : points) {
    if (point.in_map) targets_.emplace(point.id, point);
  }
  return absl::OkStatus();
}

StatusOr<std::vector<Eigen::Vector3d>> FragmentMerge::ObserverCenters(MapWriter& writer, const PointRecord& point) {
  std::vector<Eigen::Vector3d> centers;
  for (const FrameId observer : point.observers) {
    auto known = centers_.find(observer);
    if (known == centers_.end()) {
      MAPP_ASSIGN_OR_RETURN(const FrameRecord frame, writer.GetFrame(observer));
      known = centers_.emplace(observer, frame.T_frame_camera.translation()).first;
    }
    centers.push_back(known->second);
  }
  return centers;
}

Status FragmentMerge::ObserveTarget(MapWriter& writer, const FrameView& view, int feature_idx, PointRecord& target) {
  MAPP_ASSIGN_OR_RETURN(const std::vector<Eigen::Vector3d> observer_centers, ObserverCenters(writer, target));
  const Sighting sighting{.frame = view.record.id,
                          .camera_center = centers_.at(view.record.id),
                          .focal_px = view.camera.MeanFocalPx(),
                          .octave = view.keyframe.features[feature_idx].keypoint.octave};
  AddObservation(target, sighting, observer_centers);
  return absl::OkStatus();
}

Status FragmentMerge::MoveFrame(MapWriter& writer, const FrameRecord& frame) {
  const Pose3 T_map_camera = S_map_session_ * frame.T_frame_camera;
  MAPP_RETURN_IF_ERROR(writer.SetFramePose(frame.id, /*in_map=*/true, T_map_camera));
  centers_[frame.id] = T_map_camera.translation();
  newest_keyframe_ = std::max(newest_keyframe_, frame.number);

  MAPP_ASSIGN_OR_RETURN(const std::vector<Observation> observations, writer.GetObservations(frame.id));
  const bool fuses = std::any_of(observations.begin(), observations.end(), [this](const Observation& observation) {
    return TargetOf(observation.point) != nullptr;
  });
  if (!fuses) return absl::OkStatus();

  MAPP_ASSIGN_OR_RETURN(const FrameView view, LoadFrame(writer, frame.id));
  std::vector<Observation> fused;
  std::unordered_set<MapPointId> observed;
  for (Observation observation : observations) {
    PointRecord* target = TargetOf(observation.point);
    if (target != nullptr) observation.point = target->id;
    // Two points of the fragment may turn out to be one: the frame observes it once.
    if (!observed.insert(observation.point).second) continue;
    fused.push_back(observation);
    if (target != nullptr) MAPP_RETURN_IF_ERROR(ObserveTarget(writer, view, observation.feature_idx, *target));
  }
  return writer.SetObservations(frame.id, fused);
}

Status FragmentMerge::MovePoints(MapWriter& writer) {
  MAPP_ASSIGN_OR_RETURN(const std::vector<PointRecord> points, writer.PointsOfSession(session_));
  std::unordered_set<MapPointId> fused_targets;
  for (PointRecord point : points) {
    if (point.in_map) continue;
    if (PointRecord* target = TargetOf(point.id)) {
      MAPP_RETURN_IF_ERROR(writer.RetirePoint(point.id, target->id));
      fused_targets.insert(target->id);
      tiles_.insert(grid_.KeyOf(target->position));
      continue;
    }
    point.in_map = true;
    point.position = S_map_session_ * point.position;
    point.view_direction = (S_map_session_.pose.rotation() * point.view_direction.cast<double>()).cast<float>();
    MAPP_RETURN_IF_ERROR(writer.UpdatePoint(point));
    if (S_map_session_.scale != 1) {
      point.reference_distance_m *= static_cast<float>(S_map_session_.scale);
      MAPP_RETURN_IF_ERROR(writer.TouchPoint(point));
    }
    tiles_.insert(grid_.KeyOf(point.position));
  }
  for (const MapPointId target : fused_targets) MAPP_RETURN_IF_ERROR(writer.TouchPoint(targets_.at(target)));
  return absl::OkStatus();
}

Status FragmentMerge::SetScale(MapWriter& writer, const SessionRecord& session) {
  if (!MeasuresDepth(session.sensor)) return absl::OkStatus();
  MAPP_ASSIGN_OR_RETURN(const MapRecord map, writer.GetMap(map_));
  if (map.has_metric_scale) return absl::OkStatus();
  const double scale = 1 / S_map_session_.scale;
  MAPP_ASSIGN_OR_RETURN(rescaled_, RescaleMap(writer, map, scale));
  MAPP_RETURN_IF_ERROR(writer.SetMetricScale(map_, true));
  tiles_.insert(rescaled_->touched_tiles.begin(), rescaled_->touched_tiles.end());
  const Pose3& pose = S_map_session_.pose;
  S_map_session_ = {1, Pose3(pose.rotation(), scale * pose.translation())};
  return absl::OkStatus();
}

Status FragmentMerge::Run(MapWriter& writer) {
  MAPP_ASSIGN_OR_RETURN(SessionRecord session, writer.GetSession(session_));
  if (session.T_map_session || session.IsQuarantined()) return absl::OkStatus();
  map_ = session.map;
  MAPP_ASSIGN_OR_RETURN(const MapRecord map, writer.GetMap(map_));
  grid_.edge_m = map.tile_edge_m;
  MAPP_ASSIGN_OR_RETURN(revision_, writer.NextRevision(map_));
  MAPP_RETURN_IF_ERROR(writer.SetCause(map_, RevisionCause::kAlignment, session_));
  MAPP_ASSIGN_OR_RETURN(const double map_unit, UnitOf(writer, map_));
  if (map_unit != map_unit_) return absl::AbortedError(fmt::format("map {} has been rescaled", map_.value()));
  MAPP_RETURN_IF_ERROR(SetScale(writer, session));
  MAPP_RETURN_IF_ERROR(LoadTargets(writer));
  MAPP_ASSIGN_OR_RETURN(const std::vector<FrameRecord> frames, writer.ListFrames(map_, session_));
  for (const FrameRecord& frame : frames) {
    if (!frame.in_map) MAPP_RETURN_IF_ERROR(MoveFrame(writer, frame));
  }
  MAPP_RETURN_IF_ERROR(MovePoints(writer));
  session.T_map_session = S_map_session_.pose;
  session.scale_map_session = S_map_session_.scale;
  session.aligned_at_keyframe = newest_keyframe_;
  MAPP_RETURN_IF_ERROR(writer.UpdateSession(session));
  merged_ = true;
  return absl::OkStatus();
}

}  // namespace

StatusOr<PointFusions> FindFusions(MapReader& reader, SessionId session, const Sim3& S_map_session) {
  MAPP_ASSIGN_OR_RETURN(const SessionRecord record, reader.GetSession(session));
  MAPP_ASSIGN_OR_RETURN(const std::vector<FrameRecord> frames, reader.ListFrames(record.map, session));
  FusionVotes votes;
  for (const FrameRecord& frame : frames) {
    if (!frame.in_map) MAPP_RETURN_IF_ERROR(VoteForFusions(reader, frame, S_map_session, votes));
  }
  PointFusions fusions;
  for (const auto& [own, targets] : votes) {
    const auto most = std::max_element(targets.begin(), targets.end(),
                                       [](const auto& a, const auto& b) { return a.second < b.second; });
    fusions.emplace(own, most->first);
  }
  return fusions;
}

Status MergeFragment(MapStore& store, TileCache& tiles, SessionEvents& events, const CallContext& context,
                     SessionId session, const Placement& placement, const PointFusions& fusions) {
  FragmentMerge merge(session, placement, fusions);
  const auto announce = [&] {
    if (!merge.merged()) return;
    const std::vector<TileKey> touched = merge.touched_tiles();
    tiles.Invalidate(merge.map(), touched);
    events.PublishToMap(merge.map(), TilesChanged{.keys = touched, .revision = merge.revision()});
    if (merge.rescaled()) AnnounceRescaled(tiles, events, merge.map(), merge.revision(), *merge.rescaled());
    events.Publish(session, SessionAligned{.T_map_session = merge.S_map_session().pose,
                                           .keyframe = merge.newest_keyframe(),
                                           .scale_map_session = merge.S_map_session().scale});
  };
  return store.Write(
      context, [&merge](MapWriter& writer) { return merge.Run(writer); }, announce);
}

}  // namespace mapp
