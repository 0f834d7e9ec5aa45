#include "storage/checks.h"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <exception>
#include <functional>
#include <vector>

namespace mapp::internal {
namespace {

/// Tile indices lie in [-kTileIndexLimit, kTileIndexLimit): what TileKey::Packed can hold.
constexpr double kTileIndexLimit = 1 << 20;

bool IsPositive(double value) { return std::isfinite(value) && value > 0; }

bool IsBox(const OrientedBox& box) {
  return box.T_frame_box.IsFinite() && IsPositive(box.size_m.x()) && IsPositive(box.size_m.y()) &&
         IsPositive(box.size_m.z());
}

/// Strictly, and without the id 0, which nothing has.
template <typename IdType>
bool Ascend(const std::vector<IdType>& ids) {
  return std::ranges::adjacent_find(ids, std::greater_equal<>()) == ids.end() && (ids.empty() || ids[0].value() > 0);
}

}  // namespace

Status NoSuchMap(MapId map) { return absl::NotFoundError(fmt::format("map {} does not exist", map.value())); }

Status NoSuchMap(const std::string& name) {
  return absl::NotFoundError(fmt::format("map \"{}\" does not exist", name));
}

Status NoSuchSession(SessionId session) {
  return absl::NotFoundError(fmt::format("session {} does not exist", session.value()));
}

Status NoSuchCamera(CameraId camera) {
  return absl::NotFoundError(fmt::format("camera {} does not exist", camera.value()));
}

Status NoSuchFrame(FrameId frame) { return absl::NotFoundError(fmt::format("frame {} does not exist", frame.value())); }

Status NoSuchPoint(MapPointId point) {
  return absl::NotFoundError(fmt::format("point {} does not exist or is retired", point.value()));
}

Status NoSuchTag(const MapRecord& map, const std::string& tag) {
  return absl::NotFoundError(fmt::format("map \"{}\" has no tag \"{}\"", map.name, tag));
}

Status MapExists(const std::string& name) { return absl::AlreadyExistsError(fmt::format("map \"{}\" exists", name)); }

Status NoSuchChange(ChangeId change) {
  return absl::NotFoundError(fmt::format("change {} does not exist", change.value()));
}

Status EvidenceIsStored(const EvidenceRecord& evidence) {
  return absl::AlreadyExistsError(
      fmt::format("evidence {} of session {} is stored", evidence.number, evidence.session.value()));
}

Status KeyframeIsStored(const FrameRecord& frame, FrameId stored) {
  return absl::AlreadyExistsError(fmt::format("keyframe {} of session {} is stored as frame {}", frame.number,
                                              frame.session.value(), stored.value()));
}

Status CheckMap(const MapRecord& map) {
  if (!IsPositive(map.tile_edge_m)) {
    return absl::InvalidArgumentError(fmt::format("map.tile_edge_m: must be positive, got {}", map.tile_edge_m));
  }
  if (!IsPositive(map.cone_range_m)) {
    return absl::InvalidArgumentError(fmt::format("map.cone_range_m: must be positive, got {}", map.cone_range_m));
  }
  return map.features.Validate();
}

Status CheckCamera(const Camera& camera) {
  if (std::isfinite(camera.stereo_baseline_m)) return absl::OkStatus();
  return absl::InvalidArgumentError("camera.stereo_baseline_m: must be finite");
}

Status CheckSession(const SessionRecord& session) {
  if (session.T_map_session && !session.T_map_session->IsFinite()) {
    return absl::InvalidArgumentError("session.T_map_session: must be finite");
  }
  if (!IsPositive(session.scale_map_session)) {
    return absl::InvalidArgumentError(
        fmt::format("session.scale_map_session: must be positive, got {}", session.scale_map_session));
  }
  return absl::OkStatus();
}

Status CheckFrame(const FrameRecord& frame, MapId map) {
  if (frame.overlap && !std::isfinite(*frame.overlap)) {
    return absl::InvalidArgumentError("frame.overlap: must be finite");
  }
  if (map == frame.map) return absl::OkStatus();
  return absl::InvalidArgumentError(fmt::format("frame.map: session {} belongs to map {}, got {}",
                                                frame.session.value(), map.value(), frame.map.value()));
}

Status CheckPose(const Pose3& T_frame_camera) {
  if (T_frame_camera.IsFinite()) return absl::OkStatus();
  return absl::InvalidArgumentError("frame.T_frame_camera: must be finite");
}

Status CheckPoint(const PointRecord& point) {
  if (!point.position.allFinite()) return absl::InvalidArgumentError("point.position: must be finite");
  if (!std::isfinite(point.confidence)) return absl::InvalidArgumentError("point.confidence: must be finite");
  if (!std::isfinite(point.reference_distance_m)) {
    return absl::InvalidArgumentError("point.reference_distance_m: must be finite");
  }
  return absl::OkStatus();
}

Status CheckPointsMap(const PointRecord& point, MapId map_of_session, MapId map) {
  if (map == map_of_session) return absl::OkStatus();
  return absl::InvalidArgumentError(fmt::format("point.session: session {} belongs to map {}, got {}",
                                                point.session.value(), map_of_session.value(), map.value()));
}

Status CheckFusion(MapId map_of_retired, MapId map_of_successor) {
  if (map_of_retired == map_of_successor) return absl::OkStatus();
  return absl::InvalidArgumentError("fused_into: a point of another map");
}

Status CheckFusesIntoAnother(MapPointId retired, std::optional<MapPointId> fused_into) {
  if (fused_into != retired) return absl::OkStatus();
  return absl::InvalidArgumentError("fused_into: a point cannot fuse into itself");
}

Status NeverLived(MapPointId point) {
  return absl::NotFoundError(fmt::format("point {} never existed", point.value()));
}

Status StillLives(MapPointId point) { return absl::AlreadyExistsError(fmt::format("point {} lives", point.value())); }

Status IsFused(MapPointId point) {
  return absl::InvalidArgumentError(fmt::format("point.id: point {} was fused into another", point.value()));
}

Status HasAnotherNumber(const PointRecord& point) {
  return absl::InvalidArgumentError(fmt::format("point.id: point {} is not the one that session {} numbered {}",
                                                point.id.value(), point.session.value(), point.session_point));
}

Status CheckChange(const ChangeRecord& change) {
  const auto refuse = [](const std::string& what) { return absl::InvalidArgumentError("change." + what); };
  const bool has_before = change.kind != ChangeKind::kAppeared;
  const bool has_after = change.kind != ChangeKind::kVanished;
  if (change.kind < ChangeKind::kAppeared || change.kind > ChangeKind::kMoved) {
    return refuse(fmt::format("kind: unknown, got {}", static_cast<int>(change.kind)));
  }
  if (change.status < ChangeStatus::kProposed || change.status > ChangeStatus::kRejected) {
    return refuse(fmt::format("status: unknown, got {}", static_cast<int>(change.status)));
  }
  if (!(change.confidence >= 0 && change.confidence <= 1)) {
    return refuse(fmt::format("confidence: must be in [0, 1], got {}", change.confidence));
  }
  if (change.after_ns > change.before_ns) {
    return refuse(fmt::format("after_ns: {} is later than before_ns, {}", change.after_ns, change.before_ns));
  }
  if (change.first_seen_ns > change.last_seen_ns) {
    return refuse(
        fmt::format("first_seen_ns: {} is later than last_seen_ns, {}", change.first_seen_ns, change.last_seen_ns));
  }
  if (has_before && !change.box_before) return refuse("box_before: is missing");
  if (has_after && !change.box_after) return refuse("box_after: is missing");
  if (change.box_before && !IsBox(*change.box_before)) return refuse("box_before: must be finite and positive");
  if (change.box_after && !IsBox(*change.box_after)) return refuse("box_after: must be finite and positive");
  if (!Ascend(change.sessions)) return refuse("sessions: must ascend");
  if (!Ascend(change.points_before)) return refuse("points_before: must ascend");
  if (!Ascend(change.points_after)) return refuse("points_after: must ascend");
  return absl::OkStatus();
}

Status CheckChangesSession(const ChangeRecord& change, SessionId session, MapId map_of_session) {
  if (map_of_session == change.map) return absl::OkStatus();
  return absl::InvalidArgumentError(fmt::format("change.sessions: session {} belongs to map {}, got {}",
                                                session.value(), map_of_session.value(), change.map.value()));
}

Status CheckChangesMap(const ChangeRecord& change, MapId map_of_stored) {
  if (map_of_stored == change.map) return absl::OkStatus();
  return absl::InvalidArgumentError(fmt::format("change.map: change {} belongs to map {}, got {}", change.id.value(),
                                                map_of_stored.value(), change.map.value()));
}

Status CheckCause(RevisionCause cause) {
  if (cause != RevisionCause::kUnknown) return absl::OkStatus();
  return absl::InvalidArgumentError("cause: must be a known one");
}

Status StillHoldsFrames(SessionId session) {
  return absl::FailedPreconditionError(fmt::format("session {} has frames in the map", session.value()));
}

Status StillHoldsPoints(SessionId session) {
  return absl::FailedPreconditionError(fmt::format("session {} has live points", session.value()));
}

Status StillFounds(SessionId session) {
  return absl::FailedPreconditionError(fmt::format("session {} is its map's founder", session.value()));
}

Status StillHasHistory(const MapRecord& map) {
  return absl::FailedPreconditionError(
      fmt::format("map \"{}\" can still be read as of revision {}", map.name, map.oldest_revision.value()));
}

Status CheckTagName(const std::string& name) {
  const bool is_number = std::all_of(name.begin(), name.end(), [](char c) { return c >= '0' && c <= '9'; });
  if (!is_number) return absl::OkStatus();  // the empty one is
  return absl::InvalidArgumentError(fmt::format("tag: must be a name that is no number, got \"{}\"", name));
}

Status CheckRevision(const MapRecord& map, Revision revision) {
  if (revision > map.revision) {
    return absl::OutOfRangeError(fmt::format("map \"{}\" has no revision {}: its last one is {}", map.name,
                                             revision.value(), map.revision.value()));
  }
  if (revision < map.oldest_revision) {
    return absl::OutOfRangeError(
        fmt::format("revision {} of map \"{}\" has been compacted away: the oldest one kept is {}", revision.value(),
                    map.name, map.oldest_revision.value()));
  }
  return absl::OkStatus();
}

Status CheckRevisionOrder(Revision from, Revision to) {
  if (from <= to) return absl::OkStatus();
  return absl::InvalidArgumentError(
      fmt::format("revisions: the first must not be later than the second, got {} and {}", from.value(), to.value()));
}

StatusOr<TileKey> TileAt(double tile_edge_m, const Eigen::Vector3d& p_map) {
  // Written so that a NaN fails it, too.
  if (!(p_map.cwiseAbs().maxCoeff() / tile_edge_m < kTileIndexLimit)) {
    return absl::InvalidArgumentError(
        fmt::format("point.position: ({}, {}, {}) m is outside of the map's tiling", p_map.x(), p_map.y(), p_map.z()));
  }
  return TileGrid{tile_edge_m}.KeyOf(p_map);
}

Status StoreIsClosed() { return absl::UnavailableError("map database is closed"); }

Status WaitedPastDeadline() {
  return absl::DeadlineExceededError("map database: the change had to wait past its deadline");
}

Status ChangeThrew(const std::exception& error) {
  return absl::InternalError(fmt::format("change of the map database threw: {}", error.what()));
}

}  // namespace mapp::internal
