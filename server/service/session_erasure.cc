#include "server/service/session_erasure.h"

#include "server/service/frame_view.h"
#include "storage/map_store.h"

#include <algorithm>
#include <map>
#include <optional>
#include <vector>

namespace mapp {
namespace {

/// Added to a point's id it makes a number that no device gives: for a point that its adopter never numbered.
constexpr uint64_t kAdoptedNumber = uint64_t{1} << 62;
/// All that is left of the history is dropped in one transaction; most of it is gone before.
constexpr int64_t kAllRows = int64_t{1} << 40;

/// The first of the frame's features that observes the point.
std::optional<size_t> FeatureOf(const FrameView& view, MapPointId point) {
  const auto found = std::ranges::find(view.points, std::optional(point));
  if (found == view.points.end()) return std::nullopt;
  return static_cast<size_t>(found - view.points.begin());
}

uint64_t NumberOf(const FrameView& view, size_t feature_idx, MapPointId point) {
  const std::optional<PointReference>& reference = view.keyframe.features[feature_idx].point;
  if (reference && reference->kind == PointReference::Kind::kSessionPoint) return reference->id;
  return kAdoptedNumber + point.value();
}

/// Hands the points to the session of a frame that observes them; how many. What it does not observe after all goes.
StatusOr<size_t> AdoptPoints(MapWriter& writer, FrameId frame, const std::vector<MapPointId>& points) {
  MAPP_ASSIGN_OR_RETURN(const FrameView view, LoadFrame(writer, frame));
  size_t num_adopted = 0;
  for (const MapPointId point : points) {
    const std::optional<size_t> feature_idx = FeatureOf(view, point);
    if (!feature_idx) {
      MAPP_RETURN_IF_ERROR(writer.RetirePoint(point, std::nullopt));
      continue;
    }
    MAPP_RETURN_IF_ERROR(writer.AdoptPoint(point, view.record.session, NumberOf(view, *feature_idx, point),
                                           view.keyframe.features[*feature_idx].descriptor));
    ++num_adopted;
  }
  return num_adopted;
}

StatusOr<size_t> HandOverPoints(MapWriter& writer, SessionId session) {
  MAPP_ASSIGN_OR_RETURN(const std::vector<PointRecord> points, writer.PointsOfSession(session));
  std::map<FrameId, std::vector<MapPointId>> by_adopter;
  for (const PointRecord& point : points) {
    if (point.session != session) continue;
    if (point.in_map && !point.observers.empty()) {
      by_adopter[point.observers.front()].push_back(point.id);
    } else {
      MAPP_RETURN_IF_ERROR(writer.RetirePoint(point.id, std::nullopt));
    }
  }
  size_t num_adopted = 0;
  for (const auto& [frame, adopted] : by_adopter) {
    MAPP_ASSIGN_OR_RETURN(const size_t num, AdoptPoints(writer, frame, adopted));
    num_adopted += num;
  }
  return num_adopted;
}

/// The oldest session with a frame in the map, if any.
StatusOr<std::optional<SessionId>> Heir(MapReader& reader, const MapRecord& map) {
  MAPP_ASSIGN_OR_RETURN(const std::vector<FrameRecord> frames, reader.ListFrames(map.id, std::nullopt));
  std::optional<SessionId> heir;
  for (const FrameRecord& frame : frames) {
    if (frame.in_map && (!heir || frame.session < *heir)) heir = frame.session;
  }
  return heir;
}

}  // namespace

StatusOr<SessionErasure> EraseSession(MapWriter& writer, SessionId session) {
  MAPP_ASSIGN_OR_RETURN(const SessionRecord record, writer.GetSession(session));
  MAPP_ASSIGN_OR_RETURN(const MapRecord map, writer.GetMap(record.map));
  SessionErasure erasure;
  MAPP_ASSIGN_OR_RETURN(erasure.revision, writer.NextRevision(map.id));
  MAPP_RETURN_IF_ERROR(writer.SetCause(map.id, RevisionCause::kErasure, std::nullopt));
  MAPP_ASSIGN_OR_RETURN(erasure.num_points_kept, HandOverPoints(writer, session));
  if (map.founder == session) {
    MAPP_ASSIGN_OR_RETURN(const std::optional<SessionId> heir, Heir(writer, map));
    MAPP_RETURN_IF_ERROR(writer.SetFounder(map.id, heir));
    // Who founds it next brings a unit of length of its own.
    if (!heir) MAPP_RETURN_IF_ERROR(writer.SetMetricScale(map.id, true));
  }
  for (int64_t num_dropped = 1; num_dropped > 0;) {
    MAPP_ASSIGN_OR_RETURN(num_dropped, writer.DropHistory(map.id, erasure.revision, kAllRows));
  }
  MAPP_RETURN_IF_ERROR(writer.EraseSession(session));
  return erasure;
}

}  // namespace mapp
