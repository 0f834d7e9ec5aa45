#include "server/service/placement_check.h"

#include <fmt/format.h>

#include <algorithm>
#include <numbers>
#include <vector>

namespace mapp {
namespace {

/// The index finds the session's own neighbouring frames first: so many are asked for that others come among them.
constexpr size_t kCandidatesAsked = 64;

constexpr double kMaxOffsetM = 0.5;
constexpr double kMaxDriftRatio = 0.03;
constexpr double kMaxTurnRad = 10.0 * std::numbers::pi / 180.0;

/// Way of the session up to the frame, metres.
StatusOr<double> WayTo(MapReader& reader, const FrameRecord& at) {
  MAPP_ASSIGN_OR_RETURN(const std::vector<FrameRecord> frames, reader.ListFrames(at.map, at.session));
  double way_m = 0;
  const FrameRecord* previous = nullptr;
  for (const FrameRecord& frame : frames) {
    if (!frame.in_map || frame.number > at.number) continue;
    if (previous != nullptr) way_m += Distance(previous->T_frame_camera, frame.T_frame_camera);
    previous = &frame;
  }
  return way_m;
}

StatusOr<KeyframeEvidence> JudgePlace(MapReader& reader, const FrameView& view, const ProjectionAlignment& found) {
  const double offset_m = Distance(found.T_map_camera, view.record.T_frame_camera);
  const double turn_rad = RotationAngle(found.T_map_camera, view.record.T_frame_camera);
  MAPP_ASSIGN_OR_RETURN(const double way_m, WayTo(reader, view.record));
  if (IsWithinDrift(view.record.T_frame_camera, found.T_map_camera, way_m)) {
    return KeyframeEvidence{Finding::kAgrees, {}};
  }
  return KeyframeEvidence{Finding::kElsewhere,
                          fmt::format("{} points of the map place it {:.2f} m and {:.1f} degrees away",
                                      found.inliers.size(), offset_m, turn_rad * 180 / std::numbers::pi)};
}

}  // namespace

bool IsWithinDrift(const Pose3& told, const Pose3& found, double way_m) {
  return Distance(told, found) <= kMaxOffsetM + kMaxDriftRatio * way_m && RotationAngle(told, found) <= kMaxTurnRad;
}

StatusOr<std::vector<FrameId>> CandidatesOfOthers(MapReader& reader, const FrameView& view, const PlaceIndex& index,
                                                  const RegistrarOptions& options) {
  const auto max_candidates = static_cast<size_t>(std::max(1, options.max_candidates));
  std::vector<FrameId> candidates;
  for (const PlaceIndex::Candidate& candidate : index.Query(view.Descriptors(), kCandidatesAsked)) {
    if (candidates.size() == max_candidates) break;
    MAPP_ASSIGN_OR_RETURN(const FrameRecord frame, reader.GetFrame(FrameId(candidate.frame)));
    if (frame.session != view.record.session && frame.in_map) candidates.push_back(frame.id);
  }
  return candidates;
}

StatusOr<KeyframeEvidence> CheckPlacement(MapReader& reader, const FrameView& view, const PlaceIndex& index,
                                          const RegistrarOptions& options) {
  MAPP_ASSIGN_OR_RETURN(const std::vector<FrameId> candidates, CandidatesOfOthers(reader, view, index, options));
  const OwnFrames others_than{.session = view.record.session};
  MAPP_ASSIGN_OR_RETURN(const VerificationResult recognised,
                        VerifyCandidates(reader, view, candidates, others_than, options));
  if (recognised.alignment) return JudgePlace(reader, view, recognised.alignment->match);

  const Pose3& T_map_camera = view.record.T_frame_camera;
  MAPP_ASSIGN_OR_RETURN(const std::vector<PointRecord> points,
                        PointsSeenNear(reader, view.record.map, others_than, T_map_camera));
  const QueryKeyframe query(view);
  const std::optional<ProjectionAlignment> refined = AlignByProjection(query, points, T_map_camera);
  const ViewAgreement agreement = refined && Distance(refined->T_map_camera, T_map_camera) <= kMaxOffsetM
                                      ? refined->agreement
                                      : CompareWithView(query, ExpectedPoints(query, points, T_map_camera), {});
  if (agreement.num_agreeing > agreement.num_contradicting) return KeyframeEvidence{Finding::kAgrees, {}};
  if (view.keyframe.partial || Tolerates(options, agreement)) return KeyframeEvidence{};
  return KeyframeEvidence{Finding::kUnlike, fmt::format("{} parts of the view contradict the map and {} agree",
                                                        agreement.num_contradicting, agreement.num_agreeing)};
}

}  // namespace mapp
