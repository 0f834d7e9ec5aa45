#include "server/service/keyframe_writer.h"

#include "server/service/point_stats.h"
#include "server/service/session_view.h"
#include "storage/map_store.h"

#include <map>
#include <optional>
#include <set>
#include <unordered_map>
#include <utility>

namespace mapp {
namespace {

/// What the features' references lead to.
struct Targets {
  std::vector<std::optional<MapPointId>> referenced;  // per feature: by its reference
  std::vector<std::optional<MapPointId>> associated;  // per feature: by its looks
  std::unordered_map<MapPointId, PointRecord> live;   // those of both that the frame may observe
};

class KeyframeWriter {
 public:
  KeyframeWriter(MapWriter& writer, const KeyframeToWrite& input) : writer_(writer), input_(input) {}

  StatusOr<WrittenKeyframe> Write() {
    WrittenKeyframe written;
    MAPP_ASSIGN_OR_RETURN(map_, writer_.GetMap(input_.session.map));
    MAPP_ASSIGN_OR_RETURN(written.revision, writer_.NextRevision(map_.id));
    MAPP_ASSIGN_OR_RETURN(Targets targets, FindTargets());
    written.admitted = IsAdmitted(targets);
    // Points name the frame as observer and the frame's observations name the points: the frame comes first.
    MAPP_ASSIGN_OR_RETURN(frame_, EnterFrame(written.admitted));
    written.frame = frame_;
    if (!written.admitted) return written;
    for (size_t i = 0; i < input_.keyframe.features.size(); ++i) {
      if (input_.keyframe.features[i].point) MAPP_RETURN_IF_ERROR(WriteFeature(i, targets));
    }
    MAPP_RETURN_IF_ERROR(writer_.SetObservations(frame_, observations_));
    if (input_.in_map) written.changes = TakeChanges();
    return written;
  }

 private:
  const KeyframeFeature& FeatureAt(size_t idx) const { return input_.keyframe.features[idx]; }

  bool IsAdmitted(const Targets& targets) const {
    if (!input_.admit) return true;
    std::vector<KnownPoint> known;
    for (size_t i = 0; i < targets.referenced.size(); ++i) {
      const auto found = targets.referenced[i] ? targets.live.find(*targets.referenced[i]) : targets.live.end();
      if (found != targets.live.end()) known.push_back({i, &found->second});
    }
    return input_.admit(known);
  }

  StatusOr<FrameId> EnterFrame(bool admitted) {
    if (input_.logged_frame) {
      MAPP_RETURN_IF_ERROR(writer_.SetFramePose(*input_.logged_frame, input_.in_map, input_.T_frame_camera));
      return *input_.logged_frame;
    }
    FrameRecord frame = MakeFrameRecord();
    if (!admitted && input_.in_map) {
      frame.in_map = false;
      frame.T_frame_camera = input_.session.S_map_session().Inverse() * input_.T_frame_camera;
    }
    return writer_.InsertFrame(frame, input_.packet, {});
  }

  FrameRecord MakeFrameRecord() const {
    FrameRecord frame;
    frame.map = map_.id;
    frame.session = input_.session.id;
    frame.camera = input_.session.camera;
    frame.number = input_.keyframe.number;
    frame.stamp_ns = input_.keyframe.stamp_ns;
    frame.in_map = input_.in_map;
    frame.T_frame_camera = input_.T_frame_camera;
    frame.partial = input_.keyframe.partial;
    frame.overlap = input_.keyframe.overlap;
    frame.num_features = static_cast<uint32_t>(input_.keyframe.features.size());
    frame.num_packet_bytes = static_cast<int64_t>(input_.packet.size());
    return frame;
  }

  StatusOr<Targets> FindTargets() {
    Targets targets;
    MAPP_ASSIGN_OR_RETURN(targets.referenced, ResolveReferences());
    targets.associated.resize(input_.keyframe.features.size());
    for (const Association& association : input_.associations) {
      targets.associated[association.feature_idx] = association.point;
    }
    std::set<MapPointId> wanted;
    for (const auto* ids : {&targets.referenced, &targets.associated}) {
      for (const std::optional<MapPointId>& id : *ids) {
        if (id) wanted.insert(*id);
      }
    }
    const std::vector<MapPointId> ids(wanted.begin(), wanted.end());
    MAPP_ASSIGN_OR_RETURN(std::vector<PointRecord> points, writer_.FindPoints(ids));
    for (PointRecord& point : points) {
      MAPP_ASSIGN_OR_RETURN(const bool observable, IsObservable(point));
      if (observable) targets.live.emplace(point.id, std::move(point));
    }
    return targets;
  }

  /// Per feature, the point that its reference stands for; a device's reference to a map point may be out of date.
  StatusOr<std::vector<std::optional<MapPointId>>> ResolveReferences() {
    std::vector<std::optional<MapPointId>> resolved(input_.keyframe.features.size());
    std::vector<uint64_t> session_points;
    std::vector<size_t> feature_idxs;
    for (size_t i = 0; i < resolved.size(); ++i) {
      const std::optional<PointReference>& reference = FeatureAt(i).point;
      if (!reference) continue;
      if (reference->kind == PointReference::Kind::kMapPoint) {
        resolved[i] = MapPointId(reference->id);
      } else {
        session_points.push_back(reference->id);
        feature_idxs.push_back(i);
      }
    }
    MAPP_ASSIGN_OR_RETURN(const auto found, writer_.FindSessionPoints(input_.session.id, session_points));
    for (size_t i = 0; i < found.size(); ++i) resolved[feature_idxs[i]] = found[i];
    return resolved;
  }

  /// A frame in the map observes the map's points, one of a fragment those of its session's fragment.
  StatusOr<bool> IsObservable(const PointRecord& point) {
    if (point.session == input_.session.id) return point.in_map == input_.in_map;
    if (!input_.in_map || !point.in_map) return false;
    auto known = session_maps_.find(point.session);
    if (known == session_maps_.end()) {
      MAPP_ASSIGN_OR_RETURN(const SessionRecord session, writer_.GetSession(point.session));
      known = session_maps_.emplace(point.session, session.map).first;
    }
    return known->second == map_.id;
  }

  Status WriteFeature(size_t feature_idx, Targets& targets) {
    const auto find_live = [&](const std::optional<MapPointId>& id) -> PointRecord* {
      const auto found = id ? targets.live.find(*id) : targets.live.end();
      return found == targets.live.end() ? nullptr : &found->second;
    };
    const PointReference& reference = *FeatureAt(feature_idx).point;
    const bool own_number = reference.kind == PointReference::Kind::kSessionPoint;
    if (PointRecord* known = find_live(targets.referenced[feature_idx])) return Observe(feature_idx, *known);
    if (own_number && !new_session_points_.insert(reference.id).second) return absl::OkStatus();
    if (PointRecord* similar = find_live(targets.associated[feature_idx])) {
      if (own_number) MAPP_RETURN_IF_ERROR(InsertFused(feature_idx, similar->id));
      return Observe(feature_idx, *similar);
    }
    return own_number ? Found(feature_idx) : absl::OkStatus();
  }

  PointRecord MakePoint(size_t feature_idx) const {
    const KeyframeFeature& feature = FeatureAt(feature_idx);
    PointRecord point;
    point.session = input_.session.id;
    point.session_point = feature.point->id;
    point.in_map = input_.in_map;
    point.position = RebuildPoint(input_.camera, input_.T_frame_camera, feature.keypoint,
                                  static_cast<double>(feature.point->depth_m));
    InitPointStats(point, SightingOf(feature), feature.descriptor, feature.point->num_observations);
    return point;
  }

  Status Found(size_t feature_idx) {
    PointRecord point = MakePoint(feature_idx);
    MAPP_ASSIGN_OR_RETURN(point.id, writer_.InsertPoint(map_.id, point));
    AddRow(feature_idx, point);
    return absl::OkStatus();
  }

  Status InsertFused(size_t feature_idx, MapPointId fused_into) {
    MAPP_ASSIGN_OR_RETURN(const MapPointId id, writer_.InsertPoint(map_.id, MakePoint(feature_idx)));
    return writer_.RetirePoint(id, fused_into);
  }

  Status Observe(size_t feature_idx, PointRecord& point) {
    if (observed_.contains(point.id)) return absl::OkStatus();
    MAPP_ASSIGN_OR_RETURN(const std::vector<Eigen::Vector3d> centers, CentersOf(point.observers));
    AddObservation(point, SightingOf(FeatureAt(feature_idx)), centers);
    MAPP_RETURN_IF_ERROR(writer_.TouchPoint(point));
    AddRow(feature_idx, point);
    return absl::OkStatus();
  }

  void AddRow(size_t feature_idx, const PointRecord& point) {
    observed_.insert(point.id);
    // A triangulated depth is no measurement: it says what the pixels have said.
    const float measured_m = MeasuresDepth(input_.session.sensor) ? FeatureAt(feature_idx).point->depth_m : 0.0F;
    observations_.push_back({static_cast<uint16_t>(feature_idx), point.id, measured_m});
    if (!input_.in_map) return;
    const TileKey key = TileGrid{map_.tile_edge_m}.KeyOf(point.position);
    changes_[key].upserted.push_back(point);
  }

  Sighting SightingOf(const KeyframeFeature& feature) const {
    return {.frame = frame_,
            .camera_center = input_.T_frame_camera.translation(),
            .focal_px = input_.camera.MeanFocalPx(),
            .octave = feature.keypoint.octave};
  }

  StatusOr<std::vector<Eigen::Vector3d>> CentersOf(std::span<const FrameId> frames) {
    std::vector<Eigen::Vector3d> centers;
    for (const FrameId frame : frames) {
      auto known = centers_.find(frame);
      if (known == centers_.end()) {
        MAPP_ASSIGN_OR_RETURN(const FrameRecord record, writer_.GetFrame(frame));
        known = centers_.emplace(frame, record.T_frame_camera.translation()).first;
      }
      centers.push_back(known->second);
    }
    return centers;
  }

  std::vector<TileChange> TakeChanges() {
    const ObserverFrame frame{{frame_, input_.T_frame_camera, static_cast<float>(input_.camera.FieldOfView())},
                              input_.session.id};
    std::vector<TileChange> changes;
    for (auto& [key, change] : changes_) {
      change.key = key;
      change.frames = {frame};
      changes.push_back(std::move(change));
    }
    return changes;
  }

  MapWriter& writer_;
  const KeyframeToWrite& input_;
  MapRecord map_;
  FrameId frame_;
  std::vector<Observation> observations_;
  std::set<MapPointId> observed_;
  std::set<uint64_t> new_session_points_;
  std::map<TileKey, TileChange> changes_;
  std::unordered_map<SessionId, MapId> session_maps_;
  std::unordered_map<FrameId, Eigen::Vector3d> centers_;
};

}  // namespace

StatusOr<WrittenKeyframe> WriteKeyframe(MapWriter& writer, const KeyframeToWrite& input) {
  return KeyframeWriter(writer, input).Write();
}

}  // namespace mapp
