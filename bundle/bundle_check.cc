#include "bundle/bundle_check.h"

#include "bundle/record_codec.h"
#include "mapp/codec/keyframe_codec.h"
#include "storage/checks.h"

#include <fmt/format.h>

#include <cmath>
#include <set>
#include <string>

namespace mapp {
namespace {

constexpr float kUnitLengthTolerance = 1e-3F;
/// Asking whether the caller is still there costs more than checking a point.
constexpr uint64_t kRecordsBetweenChecks = 256;

Status Wrong(const std::string& what) {
  return absl::DataLossError(fmt::format("the bundle cannot be imported, {}: export the map again", what));
}

/// In a bundle's words.
Status AsWrong(const std::string& of, const Status& status) {
  return status.ok() ? status : Wrong(fmt::format("{}: {}", of, std::string(status.message())));
}

uint8_t KindOfFrames() { return KindOf(BundleFrame()); }

}  // namespace

Status BundleChecker::Take(const BundleRecord& record) {
  const uint8_t kind = KindOf(record);
  if (!map_ && !std::holds_alternative<BundleMap>(record)) return Wrong("it does not begin with its map");
  if (kind < last_kind_) return Wrong(fmt::format("a {} after a {}", KindName(kind), KindName(last_kind_)));
  if (last_kind_ < KindOfFrames() && kind >= KindOfFrames() && !points_.Seal()) return Wrong("it has a point twice");
  if (last_kind_ <= KindOfFrames() && kind > KindOfFrames() && !frames_.Seal()) return Wrong("it has a frame twice");
  last_kind_ = kind;
  return std::visit([this](const auto& it) { return Check(it); }, record);
}

Status BundleChecker::Finish() {
  if (!map_) return Wrong("it is empty");
  const std::optional<SessionId>& founder = map_->map.founder;
  if (founder && !sessions_.contains(*founder)) return Wrong("its founder is none of its sessions");
  if (!observed_.Seal()) return Wrong("it has the observers of a point twice");
  // Where nothing came after them.
  if (last_kind_ < KindOfFrames() && !points_.Seal()) return Wrong("it has a point twice");
  if (last_kind_ <= KindOfFrames() && !frames_.Seal()) return Wrong("it has a frame twice");
  return absl::OkStatus();
}

Status BundleChecker::Check(const BundleMap& record) {
  if (map_) return Wrong("it has two maps");
  map_ = record;
  return AsWrong("map", internal::CheckMap(record.map));
}

Status BundleChecker::Check(const CameraRecord& record) {
  MAPP_RETURN_IF_ERROR(AsWrong(fmt::format("camera {}", record.id.value()), record.camera.Validate()));
  if (cameras_.emplace(record.id, record.camera).second) return absl::OkStatus();
  return Wrong(fmt::format("it has camera {} twice", record.id.value()));
}

Status BundleChecker::Check(const SessionRecord& session) {
  const std::string name = fmt::format("session {}", session.id.value());
  MAPP_RETURN_IF_ERROR(AsWrong(name, internal::CheckSession(session)));
  if (!cameras_.contains(session.camera)) return Wrong(fmt::format("{} has a camera that is not there", name));
  if (!session.closed_ns) return Wrong(fmt::format("{} is open", name));
  if (session.device.empty()) return Wrong(fmt::format("{} has no device", name));
  const KnownSession known{session.camera, session.T_map_session.has_value()};
  if (session.id != SessionId() && sessions_.emplace(session.id, known).second) return absl::OkStatus();
  return Wrong(fmt::format("it has {} twice", name));
}

Status BundleChecker::Check(const PointRecord& point) {
  const std::string name = fmt::format("point {}", point.id.value());
  MAPP_RETURN_IF_ERROR(AsWrong(name, internal::CheckPoint(point)));
  if (!sessions_.contains(point.session)) return Wrong(fmt::format("{} is of a session that is not there", name));
  // Written so that a NaN fails it, too.
  if (!(std::abs(point.view_direction.norm() - 1) < kUnitLengthTolerance)) {
    return Wrong(fmt::format("{}: its direction is not of unit length", name));
  }
  if (point.confidence < 0 || point.confidence > 1) {
    return Wrong(fmt::format("{}: its confidence is {}", name, point.confidence));
  }
  if (point.in_map) {
    MAPP_RETURN_IF_ERROR(AsWrong(name, internal::TileAt(map_->map.tile_edge_m, point.position).status()));
  }
  if (point.id == MapPointId()) return Wrong("a point has no number");
  points_.Add(point.id.value());
  return absl::OkStatus();
}

Status BundleChecker::Check(const BundleFrame& frame) {
  const std::string name = fmt::format("frame {}", frame.id.value());
  const StatusOr<Keyframe> keyframe = DecodeKeyframe(frame.packet);
  MAPP_RETURN_IF_ERROR(AsWrong(name, keyframe.status()));
  const auto session = sessions_.find(keyframe->session);
  if (session == sessions_.end()) return Wrong(fmt::format("{} is of a session that is not there", name));
  if (frame.in_map && !session->second.is_aligned) {
    return Wrong(fmt::format("{} is in the map, and its session has no place there", name));
  }
  if (!keyframes_.emplace(keyframe->session, keyframe->number).second) {
    return Wrong(fmt::format("it has keyframe {} of session {} twice", keyframe->number, keyframe->session.value()));
  }
  const Camera& camera = cameras_.at(session->second.camera);
  MAPP_RETURN_IF_ERROR(AsWrong(name, Validate(*keyframe, camera, map_->map.features)));
  MAPP_RETURN_IF_ERROR(CheckObservations(frame, keyframe->features.size()));
  frames_.Add(frame.id.value());
  return absl::OkStatus();
}

Status BundleChecker::CheckObservations(const BundleFrame& frame, size_t num_features) const {
  std::set<uint16_t> features;
  std::set<MapPointId> points;
  for (const Observation& seen : frame.observations) {
    const bool is_possible = seen.feature_idx < num_features && seen.depth_m >= 0 && std::isfinite(seen.depth_m);
    if (!is_possible || !features.insert(seen.feature_idx).second || !points.insert(seen.point).second ||
        !points_.Contains(seen.point.value())) {
      return Wrong(fmt::format("frame {} cannot have observed point {} with feature {}", frame.id.value(),
                               seen.point.value(), seen.feature_idx));
    }
  }
  return absl::OkStatus();
}

Status BundleChecker::Check(const PointObservers& observers) {
  const uint64_t point = observers.point.value();
  if (!points_.Contains(point)) return Wrong(fmt::format("observers of point {}, which is not there", point));
  for (const FrameId frame : observers.frames) {
    if (!frames_.Contains(frame.value())) {
      return Wrong(fmt::format("frame {} observes point {}, and is not there", frame.value(), point));
    }
  }
  observed_.Add(point);
  return absl::OkStatus();
}

Status BundleChecker::Check(const FusedPoint& fused) {
  if (points_.Contains(fused.point.value()) && sessions_.contains(fused.session)) return absl::OkStatus();
  return Wrong(fmt::format("point {} of session {} is fused into what is not there", fused.session_point,
                           fused.session.value()));
}

Status BundleChecker::Check(const BundleTag& tag) { return AsWrong("tag", internal::CheckTagName(tag.name)); }

StatusOr<BundleSummary> CheckBundle(const CallContext& context, ByteSource source,
                                    const std::function<void(uint64_t bytes_done)>& on_progress) {
  MAPP_ASSIGN_OR_RETURN(BundleReader reader, BundleReader::Open(std::move(source)));
  BundleChecker checker;
  for (uint64_t i = 0;; ++i) {
    if (i % kRecordsBetweenChecks == 0) MAPP_RETURN_IF_ERROR(context.Check());
    MAPP_ASSIGN_OR_RETURN(const std::optional<BundleRecord> record, reader.Next());
    if (!record) break;
    MAPP_RETURN_IF_ERROR(checker.Take(*record));
    if (on_progress) on_progress(reader.num_bytes());
  }
  MAPP_RETURN_IF_ERROR(checker.Finish());
  return BundleSummary{checker.map(), reader.counts(), reader.num_bytes()};
}

}  // namespace mapp
