#include "server/service/placement_refiner.h"

#include "server/service/map_scale.h"
#include "server/service/placement_check.h"
#include "server/service/session_correction.h"
#include "server/service/session_view.h"

#include <numbers>
#include <utility>

namespace mapp {
namespace {

/// Keyframes nearer than both of these to the one asked last would say the same.
constexpr double kNextViewM = 0.2;
constexpr double kNextViewRad = 10.0 * std::numbers::pi / 180.0;
/// After a restart a session is put where twice as many keyframes say.
constexpr size_t kFewWords = 3;
/// More would not tell more.
constexpr size_t kMaxWords = 96;

}  // namespace

void PlacementRefiner::Begin(SessionId session, PlacementWords words) {
  const size_t num_told = words.consensus.size();
  sessions_.insert_or_assign(session, PlacedSession{std::move(words), num_told, std::nullopt});
}

PlacementRefiner::PlacedSession& PlacementRefiner::Placed(SessionId session, double map_unit) {
  const auto placed = sessions_.find(session);
  if (placed != sessions_.end() && placed->second.words.map_unit == map_unit) return placed->second;
  const auto [begun, is_new] = sessions_.insert_or_assign(
      session, PlacedSession{{map_unit, AlignmentConsensus(options_)}, kFewWords, std::nullopt});
  return begun->second;
}

Status PlacementRefiner::OnFrame(MapReader& reader, const FrameRecord& frame, const PlaceIndex& index) {
  MAPP_ASSIGN_OR_RETURN(const SessionRecord session, reader.GetSession(frame.session));
  MAPP_ASSIGN_OR_RETURN(const MapRecord map, reader.GetMap(frame.map));
  if (MeasuresDepth(session.sensor) || map.founder == session.id) return absl::OkStatus();
  MAPP_ASSIGN_OR_RETURN(const double map_unit, UnitOf(reader, frame.map));
  PlacedSession& placed = Placed(session.id, map_unit);
  if (placed.words.consensus.size() >= kMaxWords) return absl::OkStatus();
  if (placed.last_asked && Distance(*placed.last_asked, frame.T_frame_camera) < kNextViewM &&
      RotationAngle(*placed.last_asked, frame.T_frame_camera) < kNextViewRad) {
    return absl::OkStatus();
  }
  placed.last_asked = frame.T_frame_camera;
  MAPP_RETURN_IF_ERROR(Ask(reader, frame, session, index, placed));
  if (placed.words.consensus.size() < 2 * placed.num_told) return absl::OkStatus();
  placed.num_told = placed.words.consensus.size();
  const std::optional<Sim3> S_map_session = placed.words.consensus.Decide();
  if (!S_map_session) return absl::OkStatus();
  const Status corrected =
      CorrectSession(store_, tiles_, events_, CallContext{}, session.id, {*S_map_session, map_unit});
  // The map has another unit by now, and the words are void.
  return absl::IsAborted(corrected) ? absl::OkStatus() : corrected;
}

Status PlacementRefiner::Ask(MapReader& reader, const FrameRecord& frame, const SessionRecord& session,
                             const PlaceIndex& index, PlacedSession& placed) {
  MAPP_ASSIGN_OR_RETURN(FrameView view, LoadFrame(reader, frame.id));
  view.depths = DepthKind::kUnscaled;  // it is the scale that is asked for
  MAPP_ASSIGN_OR_RETURN(const std::vector<FrameId> candidates, CandidatesOfOthers(reader, view, index, options_));
  MAPP_ASSIGN_OR_RETURN(VerificationResult result,
                        VerifyCandidates(reader, view, candidates, {.session = session.id}, options_));
  if (!result.alignment) return absl::OkStatus();
  // Told in the session's own frame and unit, as before it merged.
  ScaleLengths(view.keyframe, 1 / session.scale_map_session);
  result.alignment->T_session_camera = view.keyframe.T_frame_camera;
  result.alignment->match.scale *= session.scale_map_session;
  placed.words.consensus.Add(*std::move(result.alignment));
  return absl::OkStatus();
}

}  // namespace mapp
