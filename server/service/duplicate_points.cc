#include "server/service/duplicate_points.h"

#include "server/service/alignment_projection.h"
#include "server/service/point_stats.h"
#include "server/service/session_events.h"
#include "server/service/tile_cache.h"

#include <algorithm>
#include <map>
#include <tuple>
#include <unordered_set>
#include <utility>

namespace mapp {
namespace {

/// A frame that saw a point from further away goes on naming the one that has gone, which only loses it one
/// observation: the work is bounded by the place, not by the map.
constexpr double kMaxSightM = 50;

class DuplicateSearch {
 public:
  DuplicateSearch(const CallContext& context, MapReader& reader) : context_(context), reader_(reader) {}

  Status CompareFrame(const FrameRecord& frame) {
    MAPP_RETURN_IF_ERROR(context_.Check());
    MAPP_ASSIGN_OR_RETURN(const FrameView view, LoadFrame(reader_, frame.id));
    std::unordered_set<MapPointId> own;
    for (const std::optional<MapPointId>& point : view.points) {
      if (!point) continue;
      own.insert(*point);
      observers_[*point].insert(frame.id);
    }
    MAPP_ASSIGN_OR_RETURN(std::vector<PointRecord> others,
                          PointsSeenNear(reader_, frame.map, OwnFrames(), frame.T_frame_camera));
    std::erase_if(others, [&own](const PointRecord& point) { return !point.in_map || own.contains(point.id); });
    const std::optional<ProjectionAlignment> alignment =
        AlignByProjection(QueryKeyframe(view), others, frame.T_frame_camera);
    if (!alignment) return absl::OkStatus();
    std::unordered_set<MapPointId> matched;
    for (const AlignmentMatch& match : alignment->inliers) {
      const std::optional<MapPointId>& point = view.points[static_cast<size_t>(match.feature_idx)];
      if (!point) continue;
      ++votes_[std::minmax(*point, match.point)];
      matched.insert(match.point);
    }
    for (const PointRecord& other : others) {
      if (matched.contains(other.id)) observers_[other.id].insert(other.observers.begin(), other.observers.end());
    }
    return absl::OkStatus();
  }

  PointFusions Decide() {
    std::vector<std::pair<int, std::pair<MapPointId, MapPointId>>> pairs;
    for (const auto& [pair, votes] : votes_) pairs.emplace_back(votes, pair);
    std::ranges::stable_sort(pairs, [](const auto& a, const auto& b) { return a.first > b.first; });
    for (const auto& [votes, pair] : pairs) Join(RootOf(pair.first), RootOf(pair.second));
    PointFusions fusions;
    for (const auto& [point, parent] : parents_) fusions.emplace(point, RootOf(parent));
    return fusions;
  }

 private:
  MapPointId RootOf(MapPointId point) const {
    for (auto parent = parents_.find(point); parent != parents_.end(); parent = parents_.find(point)) {
      point = parent->second;
    }
    return point;
  }

  void Join(MapPointId a, MapPointId b) {
    if (a == b) return;
    std::set<FrameId>& of_a = observers_[a];
    std::set<FrameId>& of_b = observers_[b];
    const bool keeps_a = std::pair(of_a.size(), b) > std::pair(of_b.size(), a);  // of equals the older
    const std::set<FrameId>& fewer = keeps_a ? of_b : of_a;
    std::set<FrameId>& more = keeps_a ? of_a : of_b;
    if (std::ranges::any_of(fewer, [&more](FrameId frame) { return more.contains(frame); })) return;
    more.insert(fewer.begin(), fewer.end());
    parents_.emplace(keeps_a ? b : a, keeps_a ? a : b);
  }

  const CallContext& context_;
  MapReader& reader_;
  std::map<MapPointId, std::set<FrameId>> observers_;
  std::map<std::pair<MapPointId, MapPointId>, int> votes_;
  std::map<MapPointId, MapPointId> parents_;
};

}  // namespace

StatusOr<PointFusions> FindDuplicatePoints(const CallContext& context, MapReader& reader,
                                           std::span<const FrameRecord> frames) {
  DuplicateSearch search(context, reader);
  for (const FrameRecord& frame : frames) MAPP_RETURN_IF_ERROR(search.CompareFrame(frame));
  return search.Decide();
}

StatusOr<uint32_t> FuseDuplicates(MapStore& store, TileCache& tiles, SessionEvents& events, const CallContext& context,
                                  MapId map, std::span<const FrameRecord> frames) {
  PointFusions fusions;
  {
    MAPP_ASSIGN_OR_RETURN(const std::unique_ptr<MapReader> reader, store.Read());
    MAPP_ASSIGN_OR_RETURN(fusions, FindDuplicatePoints(context, *reader, frames));
  }
  if (fusions.empty()) return 0;
  DuplicateFusion fusion(map, fusions);
  MAPP_RETURN_IF_ERROR(store.Write(
      context, [&fusion](MapWriter& writer) { return fusion.Run(writer); },
      [&] {
        tiles.Invalidate(map, fusion.touched_tiles());
        events.PublishToMap(map, TilesChanged{.keys = fusion.touched_tiles(), .revision = fusion.revision()});
      }));
  return fusion.num_fused();
}

PointRecord* DuplicateFusion::TargetOf(MapPointId point) {
  const auto fusion = fusions_.find(point);
  if (fusion == fusions_.end() || !points_.contains(point)) return nullptr;
  const auto target = points_.find(fusion->second);
  return target == points_.end() ? nullptr : &target->second;
}

Aabb DuplicateFusion::WhereSeenFrom() const {
  Aabb box;
  for (const auto& [id, point] : points_) box.extend(point.position);
  const Eigen::Vector3d reach = Eigen::Vector3d::Constant(kMaxSightM);
  return Aabb(box.min() - reach, box.max() + reach);
}

StatusOr<Eigen::Vector3d> DuplicateFusion::CenterOf(MapWriter& writer, FrameId frame) {
  auto known = centers_.find(frame);
  if (known == centers_.end()) {
    MAPP_ASSIGN_OR_RETURN(const FrameRecord record, writer.GetFrame(frame));
    known = centers_.emplace(frame, record.T_frame_camera.translation()).first;
  }
  return known->second;
}

Status DuplicateFusion::LoadPoints(MapWriter& writer) {
  std::set<MapPointId> ids;
  for (const auto& [point, target] : fusions_) {
    ids.insert(point);
    ids.insert(target);
  }
  const std::vector<MapPointId> ordered(ids.begin(), ids.end());
  MAPP_ASSIGN_OR_RETURN(const std::vector<PointRecord> points, writer.FindPoints(ordered));
  for (const PointRecord& point : points) {
    if (point.in_map) points_.emplace(point.id, point);
  }
  return absl::OkStatus();
}

Status DuplicateFusion::RewriteFrame(MapWriter& writer, const FrameRecord& frame) {
  MAPP_ASSIGN_OR_RETURN(const std::vector<Observation> observations, writer.GetObservations(frame.id));
  if (std::ranges::none_of(observations, [this](const Observation& seen) { return TargetOf(seen.point) != nullptr; })) {
    return absl::OkStatus();
  }
  MAPP_ASSIGN_OR_RETURN(const FrameView view, LoadFrame(writer, frame.id));
  std::unordered_set<MapPointId> observed;
  for (const Observation& observation : observations) {
    if (TargetOf(observation.point) == nullptr) observed.insert(observation.point);
  }
  std::vector<Observation> fused;
  for (Observation observation : observations) {
    if (PointRecord* target = TargetOf(observation.point)) {
      // A frame that came meanwhile may see both: it observes what stays once.
      if (!observed.insert(target->id).second) continue;
      observation.point = target->id;
      std::vector<Eigen::Vector3d> observer_centers;
      for (const FrameId observer : target->observers) {
        MAPP_ASSIGN_OR_RETURN(const Eigen::Vector3d center, CenterOf(writer, observer));
        observer_centers.push_back(center);
      }
      AddObservation(*target,
                     {.frame = frame.id,
                      .camera_center = frame.T_frame_camera.translation(),
                      .focal_px = view.camera.MeanFocalPx(),
                      .octave = view.keyframe.features[observation.feature_idx].keypoint.octave},
                     observer_centers);
    }
    fused.push_back(observation);
  }
  return writer.SetObservations(frame.id, fused);
}

Status DuplicateFusion::Run(MapWriter& writer) {
  MAPP_ASSIGN_OR_RETURN(const MapRecord map, writer.GetMap(map_));
  const TileGrid grid{.edge_m = map.tile_edge_m};
  MAPP_ASSIGN_OR_RETURN(revision_, writer.NextRevision(map_));
  MAPP_RETURN_IF_ERROR(writer.SetCause(map_, RevisionCause::kFusion, std::nullopt));
  MAPP_RETURN_IF_ERROR(LoadPoints(writer));
  if (points_.empty()) return absl::OkStatus();
  MAPP_ASSIGN_OR_RETURN(const std::vector<FrameRecord> frames, writer.FramesInBox(map_, WhereSeenFrom()));
  for (const FrameRecord& frame : frames) MAPP_RETURN_IF_ERROR(RewriteFrame(writer, frame));
  std::set<MapPointId> targets;
  for (const auto& [point, fused_into] : fusions_) {
    const PointRecord* target = TargetOf(point);
    if (target == nullptr) continue;
    tiles_.insert(grid.KeyOf(points_.at(point).position));
    tiles_.insert(grid.KeyOf(target->position));
    MAPP_RETURN_IF_ERROR(writer.RetirePoint(point, target->id));
    targets.insert(target->id);
    ++num_fused_;
  }
  for (const MapPointId target : targets) MAPP_RETURN_IF_ERROR(writer.TouchPoint(points_.at(target)));
  return absl::OkStatus();
}

}  // namespace mapp
