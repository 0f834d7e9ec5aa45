#include "server/service/way_check.h"

#include "server/service/alignment_projection.h"
#include "server/service/frame_view.h"

#include <algorithm>
#include <numbers>
#include <vector>

namespace mapp {
namespace {

/// Keyframes are looked at that differ from each other by at least one of these ...
constexpr double kStepM = 0.7;
constexpr double kStepRad = 20.0 * std::numbers::pi / 180.0;
/// ... and not more of them: further away, drift of the session's odometry would pass for a contradiction.
constexpr size_t kMaxViews = 16;
/// How far odometry may have drifted over such a way. A view that matches elsewhere does not speak for this pose.
constexpr double kMaxDriftM = 0.3;
constexpr double kMaxDriftRad = 3.0 * std::numbers::pi / 180.0;

/// `scale`: metres a unit of their poses.
bool ShowsTheSame(const FrameRecord& a, const FrameRecord& b, double scale) {
  return scale * Distance(a.T_frame_camera, b.T_frame_camera) <= kStepM &&
         RotationAngle(a.T_frame_camera, b.T_frame_camera) <= kStepRad;
}

/// The fragment's keyframes from `at` on outwards, before and after it, some steps apart.
std::vector<FrameRecord> WayAround(std::vector<FrameRecord> frames, const FrameRecord& at, double scale) {
  const auto steps_away = [&](const FrameRecord& frame) {
    return std::max(frame.number, at.number) - std::min(frame.number, at.number);
  };
  std::stable_sort(frames.begin(), frames.end(),
                   [&](const auto& a, const auto& b) { return steps_away(a) < steps_away(b); });
  std::vector<FrameRecord> way;
  for (FrameRecord& frame : frames) {
    if (way.size() == kMaxViews) break;
    const bool is_new =
        std::ranges::none_of(way, [&](const FrameRecord& chosen) { return ShowsTheSame(chosen, frame, scale); });
    if (is_new) way.push_back(std::move(frame));
  }
  return way;
}

ViewAgreement CompareOne(const QueryKeyframe& query, const std::vector<PointRecord>& points,
                         const Pose3& T_map_camera) {
  const std::optional<ProjectionAlignment> refined = AlignByProjection(query, points, T_map_camera);
  if (refined && Distance(refined->T_map_camera, T_map_camera) < kMaxDriftM &&
      RotationAngle(refined->T_map_camera, T_map_camera) < kMaxDriftRad) {
    return refined->agreement;
  }
  return CompareWithView(query, ExpectedPoints(query, points, T_map_camera), {});
}

}  // namespace

StatusOr<ViewAgreement> CompareWayWithMap(MapReader& reader, const FrameRecord& at, const Sim3& S_map_session,
                                          const OwnFrames& way) {
  MAPP_ASSIGN_OR_RETURN(std::vector<FrameRecord> frames, reader.ListFrames(at.map, at.session));
  std::erase_if(frames, [&](const FrameRecord& frame) { return frame.in_map != at.in_map || !way.Contains(frame); });
  ViewAgreement sum;
  for (const FrameRecord& frame : WayAround(std::move(frames), at, S_map_session.scale)) {
    MAPP_ASSIGN_OR_RETURN(const FrameView view, LoadFrame(reader, frame.id));
    const Pose3 T_map_camera = S_map_session * frame.T_frame_camera;
    MAPP_ASSIGN_OR_RETURN(const std::vector<PointRecord> points, PointsSeenNear(reader, at.map, way, T_map_camera));
    const ViewAgreement agreement = CompareOne(QueryKeyframe(view).AtScale(S_map_session.scale), points, T_map_camera);
    sum.num_agreeing += agreement.num_agreeing;
    sum.num_contradicting += agreement.num_contradicting;
  }
  return sum;
}

}  // namespace mapp
