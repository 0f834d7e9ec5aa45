#include "server/service/duplicate_points.h"

#include "server/service/alignment_projection.h"
#include "server/service/point_stats.h"

#include <algorithm>
#include <map>
#include <tuple>
#include <unordered_set>
#include <utility>

namespace mapp {
namespace {

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
                          PointsSeenNear(reader_, frame.map, SessionId(), frame.T_frame_camera));
    std::erase_if(others, [&own](const PointRecord& point) { return !point.in_map || own.contains(point.id); });
    const std::optional<ProjectionAlignment> alignment =
        AlignByProjection(QueryKeyframe(view), others, frame.T_frame_camera);
    if (!alignment) return absl::OkStatus();
    for (const AlignmentMatch& match : alignment->inliers) {
      const std::optional<MapPointId>& point = view.points[static_cast<size_t>(match.feature_idx)];
      if (point) ++votes_[std::minmax(*point, match.point)];
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

StatusOr<PointFusions> FindDuplicatePoints(const CallContext& context, MapReader& reader, MapId map) {
  MAPP_ASSIGN_OR_RETURN(const std::vector<FrameRecord> frames, reader.ListFrames(map, std::nullopt));
  DuplicateSearch search(context, reader);
  for (const FrameRecord& frame : frames) {
    if (frame.in_map) MAPP_RETURN_IF_ERROR(search.CompareFrame(frame));
  }
  return search.Decide();
}

PointRecord* DuplicateFusion::TargetOf(MapPointId point) {
  const auto fusion = fusions_.find(point);
  if (fusion == fusions_.end() || !points_.contains(point)) return nullptr;
  const auto target = points_.find(fusion->second);
  return target == points_.end() ? nullptr : &target->second;
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
      for (const FrameId observer : target->observers) observer_centers.push_back(centers_.at(observer));
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
  MAPP_RETURN_IF_ERROR(LoadPoints(writer));
  MAPP_ASSIGN_OR_RETURN(const std::vector<FrameRecord> frames, writer.ListFrames(map_, std::nullopt));
  for (const FrameRecord& frame : frames) centers_.emplace(frame.id, frame.T_frame_camera.translation());
  for (const FrameRecord& frame : frames) {
    if (frame.in_map) MAPP_RETURN_IF_ERROR(RewriteFrame(writer, frame));
  }
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
