#include "server/service/loop_closer.h"

#include "server/service/alignment_consensus.h"
#include "server/service/loop_correction.h"
#include "server/service/placement_check.h"
#include "server/service/session_view.h"
#include "server/service/way_check.h"

#include <algorithm>
#include <numbers>
#include <unordered_map>
#include <unordered_set>
#include <utility>

namespace mapp {
namespace {

/// Odometry drifts by turning, too: a radian counts as so many metres of way.
constexpr double kMetersPerRad = 0.5;
/// What a session saw within so much way of a keyframe does not tell of drift.
constexpr double kMinWayM = 3;
/// Keyframes nearer than both of these to the one asked last would say the same.
constexpr double kNextLoopViewM = 0.3;
constexpr double kNextLoopViewRad = 10 * std::numbers::pi / 180;
/// Keyframes whose words are compared, the latest ones: before them the session had drifted less.
constexpr size_t kMaxLoopWords = 8;
/// Less than this, association bridges and adjustment takes away.
constexpr double kMinOffsetM = 0.08;
constexpr double kMinTurnRad = 1.5 * std::numbers::pi / 180;

double WayBetween(const Pose3& a, const Pose3& b) { return Distance(a, b) + kMetersPerRad * RotationAngle(a, b); }

/// Whether a frame shares points with one of the others.
StatusOr<bool> IsJoined(MapReader& reader, FrameId frame, std::span<const FrameId> others) {
  std::unordered_set<MapPointId> own;
  MAPP_ASSIGN_OR_RETURN(const std::vector<Observation> seen, reader.GetObservations(frame));
  for (const Observation& observation : seen) own.insert(observation.point);
  for (const FrameId other : others) {
    MAPP_ASSIGN_OR_RETURN(const std::vector<Observation> observations, reader.GetObservations(other));
    const auto num_shared =
        std::ranges::count_if(observations, [&own](const Observation& o) { return own.contains(o.point); });
    if (num_shared >= kMinJoiningPoints) return true;
  }
  return false;
}

/// Of the frames besides `stretch` that see the matched points, the one that sees most of them; nullopt when only
/// frames do that the points no longer list.
StatusOr<std::optional<FrameRecord>> AnchorOf(MapReader& reader, const ProjectionAlignment& match,
                                              const OwnFrames& stretch) {
  std::vector<MapPointId> ids;
  for (const AlignmentMatch& inlier : match.inliers) ids.push_back(inlier.point);
  MAPP_ASSIGN_OR_RETURN(const std::vector<PointRecord> points, reader.FindPoints(ids));
  std::map<FrameId, int> counts;
  for (const PointRecord& point : points) {
    for (const FrameId observer : point.observers) ++counts[observer];
  }
  std::optional<FrameRecord> anchor;
  int most = 0;
  for (const auto& [id, count] : counts) {
    if (count <= most) continue;
    MAPP_ASSIGN_OR_RETURN(FrameRecord frame, reader.GetFrame(id));
    if (!frame.in_map || stretch.Contains(frame)) continue;
    anchor = std::move(frame);
    most = count;
  }
  return anchor;
}

}  // namespace

StatusOr<LoopCloser::Walk*> LoopCloser::Follow(MapReader& reader, const FrameRecord& frame) {
  const auto [entry, is_new] = walks_.try_emplace(frame.session);
  Walk& walk = entry->second;
  if (walk.steps.contains(frame.number)) return &walk;
  std::vector<FrameRecord> frames = {frame};
  if (is_new || walk.steps.empty() || frame.number < walk.steps.rbegin()->first) {
    walk.steps.clear();
    MAPP_ASSIGN_OR_RETURN(frames, reader.ListFrames(frame.map, frame.session));
    std::erase_if(frames, [](const FrameRecord& record) { return !record.in_map; });
    std::ranges::sort(frames, {}, &FrameRecord::number);
  }
  for (const FrameRecord& record : frames) {
    Step step{record.id, record.T_frame_camera, 0};
    if (!walk.steps.empty()) {
      const Step& last = walk.steps.rbegin()->second;
      step.way_m = last.way_m + WayBetween(last.T_map_camera, step.T_map_camera);
    }
    walk.steps.emplace(record.number, step);
  }
  return &walk;
}

StatusOr<std::optional<LoopCloser::Word>> LoopCloser::Ask(MapReader& reader, const FrameView& view,
                                                          std::span<const FrameId> candidates, const OwnFrames& stretch,
                                                          double way_m) const {
  const FrameRecord& frame = view.record;
  MAPP_ASSIGN_OR_RETURN(VerificationResult result, VerifyCandidates(reader, view, candidates, stretch, options_));
  // Further away than odometry drifts is another place that looks the same, or an error that the guard judges.
  if (!result.alignment || !IsWithinDrift(frame.T_frame_camera, result.alignment->match.T_map_camera, way_m)) {
    return std::nullopt;
  }
  MAPP_ASSIGN_OR_RETURN(const std::optional<FrameRecord> anchor, AnchorOf(reader, result.alignment->match, stretch));
  if (!anchor) return std::nullopt;
  const Pose3 T_anchor_frame = anchor->T_frame_camera.Inverse() * result.alignment->match.T_map_camera;
  return Word{*std::move(result.alignment), {anchor->id, frame.id, T_anchor_frame}};
}

StatusOr<bool> LoopCloser::Decide(const CallContext& context, MapReader& reader, const FrameRecord& frame,
                                  const OwnFrames& stretch, Walk& walk) {
  AlignmentConsensus consensus(options_);
  for (const Word& word : walk.words) consensus.Add(word.alignment);
  const std::optional<Sim3> correction = consensus.Decide();
  if (!correction) return false;
  const Pose3 T_map_camera = *correction * frame.T_frame_camera;
  if (Distance(T_map_camera, frame.T_frame_camera) < kMinOffsetM &&
      RotationAngle(T_map_camera, frame.T_frame_camera) < kMinTurnRad) {
    return false;
  }
  // Should this be none, the next metres would only say the same.
  walk.silent_until_m = walk.steps.at(frame.number).way_m + kMinWayM;
  const std::deque<Word> words = std::exchange(walk.words, {});
  MAPP_ASSIGN_OR_RETURN(const ViewAgreement way, CompareWayWithMap(reader, frame, *correction, stretch));
  if (!Tolerates(options_, way)) return false;
  Loop loop{frame.map, stretch, {}};
  for (const Word& word : words) {
    if (AgreesWith(word.alignment, *correction, options_)) loop.matches.push_back(word.match);
  }
  MAPP_ASSIGN_OR_RETURN(std::optional<ClosedLoop> closed, CloseLoop(store_, tiles_, events_, context, loop));
  if (!closed) return false;
  // Ways lead elsewhere in the map now, and what keyframes have said is of the map as it was.
  walks_.clear();
  const StatusOr<uint32_t> num_fused = FuseVisit(store_, tiles_, events_, context, loop);
  if (num_fused.ok()) closed->num_fused = *num_fused;
  // Left double, they are found by an operator's optimization of the map.
  if (!num_fused.ok() && !absl::IsCancelled(num_fused.status()) && options_.on_error) {
    options_.on_error(frame.session, num_fused.status());
  }
  if (options_.on_loop_closed) options_.on_loop_closed(frame.session, *closed);
  MAPP_ASSIGN_OR_RETURN(const std::unique_ptr<MapReader> now, store_.Read());
  MAPP_ASSIGN_OR_RETURN(const SessionRecord session, now->GetSession(frame.session));
  if (session.optimized && options_.on_optimization_due) options_.on_optimization_due(session.id);
  return true;
}

StatusOr<bool> LoopCloser::OnFrame(const CallContext& context, MapReader& reader, const FrameRecord& frame,
                                   const PlaceIndex& index) {
  MAPP_ASSIGN_OR_RETURN(const SessionRecord session, reader.GetSession(frame.session));
  if (!MeasuresDepth(session.sensor) || session.IsQuarantined()) return false;
  MAPP_ASSIGN_OR_RETURN(Walk* const walk, Follow(reader, frame));
  if (walk->last_asked && Distance(*walk->last_asked, frame.T_frame_camera) < kNextLoopViewM &&
      RotationAngle(*walk->last_asked, frame.T_frame_camera) < kNextLoopViewRad) {
    return false;
  }
  const double way_m = walk->steps.at(frame.number).way_m;
  if (way_m < walk->silent_until_m && way_m > walk->silent_until_m - 2 * kMinWayM) return false;
  OwnFrames stretch{frame.session, frame.number, frame.number};
  std::unordered_set<uint64_t> left_out;
  for (const auto& [number, step] : walk->steps) {
    if (std::abs(step.way_m - way_m) > kMinWayM) continue;
    stretch.first_number = std::min(stretch.first_number, number);
    stretch.last_number = std::max(stretch.last_number, number);
    left_out.insert(step.frame.value());
  }
  MAPP_ASSIGN_OR_RETURN(const std::vector<OrbDescriptor> descriptors, LoadDescriptors(reader, frame.id));
  std::vector<FrameId> candidates;
  for (const PlaceIndex::Candidate& candidate :
       index.Query(descriptors, static_cast<size_t>(options_.max_candidates),
                   [&left_out](uint64_t id) { return !left_out.contains(id); })) {
    candidates.emplace_back(candidate.frame);
  }
  if (candidates.empty()) return false;
  MAPP_ASSIGN_OR_RETURN(const bool is_joined, IsJoined(reader, frame.id, candidates));
  if (is_joined) return false;
  walk->last_asked = frame.T_frame_camera;
  MAPP_ASSIGN_OR_RETURN(const FrameView view, LoadFrame(reader, frame.id));
  MAPP_ASSIGN_OR_RETURN(std::optional<Word> word, Ask(reader, view, candidates, stretch, way_m));
  if (!word) return false;
  walk->words.push_back(*std::move(word));
  if (walk->words.size() > kMaxLoopWords) walk->words.pop_front();
  return Decide(context, reader, frame, stretch, *walk);
}

}  // namespace mapp
