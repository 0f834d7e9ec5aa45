// Fragments: where they lie, their way into the map, and when they are tried again.
#include "server/service/map_scale.h"
#include "server/service/merger.h"
#include "server/service/registrar_impl.h"
#include "server/service/session_view.h"
#include "server/service/step_times.h"
#include "server/service/way_check.h"

#include <algorithm>
#include <utility>

namespace mapp {
namespace {

/// Earlier keyframes of a fragment looked at again when the registrar meets it for the first time after a start.
constexpr size_t kKeyframesRevisited = 6;
/// Of a merged fragment, each third frame is looked at as one that joins the map: neighbours look alike.
constexpr size_t kJoinedStep = 3;
/// Fragments tried again for one frame that joins the map ...
constexpr size_t kMaxRecalled = 2;
/// ... and where a keyframe of the fragment finds its place, so many before and after it are asked too.
constexpr size_t kNeighborsAsked = 2;

}  // namespace

StatusOr<AlignmentTried> Registrar::Impl::TryKeyframe(MapReader& reader, const FrameView& view, const PlaceIndex& index,
                                                      AlignmentConsensus& consensus) const {
  std::vector<FrameId> candidates;
  for (const PlaceIndex::Candidate& candidate :
       index.Query(view.Descriptors(), static_cast<size_t>(options.max_candidates))) {
    candidates.emplace_back(candidate.frame);
  }
  AlignmentTried tried{.keyframe = view.record.number, .num_candidates = static_cast<uint32_t>(candidates.size())};
  if (candidates.empty()) return tried;
  MAPP_ASSIGN_OR_RETURN(VerificationResult result,
                        VerifyCandidates(reader, view, candidates, {.session = view.record.session}, options));
  tried.num_inliers = static_cast<uint32_t>(result.best_inliers);
  if (result.alignment) tried.num_consistent = static_cast<uint32_t>(consensus.Add(std::move(*result.alignment)));
  return tried;
}

/// What the fragment's keyframes have said so far. Met for the first time after a start, the fragment's last keyframes
/// before `newest` are asked again: what they said was only in memory.
StatusOr<AlignmentConsensus*> Registrar::Impl::ConsensusOf(MapReader& reader, const FrameRecord& newest,
                                                           MapState& state) const {
  MAPP_ASSIGN_OR_RETURN(const double map_unit, UnitOf(reader, newest.map));
  auto [fragment, is_new] = state.fragments.try_emplace(newest.session, map_unit, AlignmentConsensus(options));
  if (fragment->second.map_unit != map_unit) {
    fragment->second = {map_unit, AlignmentConsensus(options)};
    is_new = true;
  }
  AlignmentConsensus* const consensus = &fragment->second.consensus;
  if (!is_new) return consensus;
  MAPP_ASSIGN_OR_RETURN(std::vector<FrameRecord> earlier, reader.ListFrames(newest.map, newest.session));
  std::erase_if(earlier, [&](const FrameRecord& frame) { return frame.id >= newest.id; });
  const size_t first = earlier.size() > kKeyframesRevisited ? earlier.size() - kKeyframesRevisited : 0;
  for (size_t i = first; i < earlier.size(); ++i) {
    MAPP_ASSIGN_OR_RETURN(const FrameView view, LoadFrame(reader, earlier[i].id));
    MAPP_RETURN_IF_ERROR(TryKeyframe(reader, view, state.places.index(), *consensus).status());
  }
  return consensus;
}

Status Registrar::Impl::ProcessFragmentFrame(MapReader& reader, const FrameRecord& frame, MapState& state) {
  MAPP_ASSIGN_OR_RETURN(const SessionRecord session, reader.GetSession(frame.session));
  if (session.T_map_session) return absl::OkStatus();  // left out of the map for good
  if (session.IsQuarantined()) {
    events.Publish(frame.session, AlignmentTried{.keyframe = frame.number});
    return absl::OkStatus();
  }
  const Stopwatch stopwatch;
  MAPP_ASSIGN_OR_RETURN(const FrameView view, LoadFrame(reader, frame.id));
  MAPP_ASSIGN_OR_RETURN(AlignmentConsensus* const consensus, ConsensusOf(reader, frame, state));
  MAPP_ASSIGN_OR_RETURN(const AlignmentTried tried, TryKeyframe(reader, view, state.places.index(), *consensus));
  state.unmerged.Add(frame.session, frame.id, view.Descriptors());
  const Status merged = MergeIfDecided(reader, frame, *consensus, state);
  if (options.step_times != nullptr) options.step_times->Add(ServiceStep::kAlignment, stopwatch.Elapsed());
  // After the merge: who waits for the comparison of a keyframe then knows what came of it.
  events.Publish(frame.session, tried);
  return merged;
}

Status Registrar::Impl::MergeIfDecided(MapReader& reader, const FrameRecord& frame, AlignmentConsensus& consensus,
                                       MapState& state) {
  const std::optional<Sim3> S_map_session = consensus.Decide();
  if (!S_map_session) return absl::OkStatus();
  MAPP_ASSIGN_OR_RETURN(const ViewAgreement way,
                        CompareWayWithMap(reader, frame, *S_map_session, {.session = frame.session}));
  if (Tolerates(options, way)) return Merge(reader, frame, *S_map_session, state);
  consensus.Forget();
  return absl::OkStatus();
}

Status Registrar::Impl::Merge(MapReader& reader, const FrameRecord& frame, const Sim3& S_map_session, MapState& state) {
  MAPP_ASSIGN_OR_RETURN(const PointFusions fusions, FindFusions(reader, frame.session, S_map_session));
  const Status merge_status = MergeFragment(store, tiles, events, CallContext{}, frame.session,
                                            {S_map_session, state.fragments.at(frame.session).map_unit}, fusions);
  // The map has another unit of length by now: its keyframes have to be asked again.
  if (absl::IsAborted(merge_status)) return absl::OkStatus();
  MAPP_RETURN_IF_ERROR(merge_status);
  MAPP_ASSIGN_OR_RETURN(const std::unique_ptr<MapReader> merged, store.Read());
  MAPP_ASSIGN_OR_RETURN(const SessionRecord session, merged->GetSession(frame.session));
  if (!MeasuresDepth(session.sensor)) refiner.Begin(session.id, std::move(state.fragments.at(session.id)));
  state.fragments.erase(frame.session);
  state.unmerged.Remove(frame.session);
  MAPP_RETURN_IF_ERROR(AddFrames(*merged, frame.map, frame.session, state));
  // Other fragments may have been where this one was, and its own way may lead back to where the map was before.
  MAPP_ASSIGN_OR_RETURN(const std::vector<FrameRecord> frames, merged->ListFrames(frame.map, frame.session));
  for (size_t i = 0; i < frames.size(); i += kJoinedStep) {
    worker.Push({.map = frame.map, .session = frame.session, .frame = frames[i].id, .retired = {}});
  }
  if (session.closed_ns) QueueClosed(frame.map, session.id);
  return absl::OkStatus();
}

Status Registrar::Impl::RecallFragments(MapReader& reader, const FrameRecord& frame, MapState& state) {
  if (state.unmerged.empty()) return absl::OkStatus();
  MAPP_ASSIGN_OR_RETURN(const std::vector<OrbDescriptor> descriptors, LoadDescriptors(reader, frame.id));
  for (const FrameId recalled : state.unmerged.LookingLike(descriptors, kMaxRecalled)) {
    // As the map stands now: the one before may have merged, and given the map another unit.
    MAPP_ASSIGN_OR_RETURN(const std::unique_ptr<MapReader> now, store.Read());
    MAPP_ASSIGN_OR_RETURN(const FrameView own, LoadFrame(*now, recalled));
    if (own.record.in_map) continue;
    // Something always looks most alike: only what also fits this one frame is worth the whole comparison.
    const FrameId joined[] = {frame.id};
    MAPP_ASSIGN_OR_RETURN(const VerificationResult fit,
                          VerifyCandidates(*now, own, joined, {.session = own.record.session}, options));
    if (fit.best_inliers < options.min_inliers) continue;
    MAPP_RETURN_IF_ERROR(TryAgain(*now, own, state));
  }
  return absl::OkStatus();
}

Status Registrar::Impl::TryAgain(MapReader& reader, const FrameView& view, MapState& state) {
  MAPP_ASSIGN_OR_RETURN(AlignmentConsensus* const consensus, ConsensusOf(reader, view.record, state));
  MAPP_ASSIGN_OR_RETURN(const AlignmentTried tried, TryKeyframe(reader, view, state.places.index(), *consensus));
  if (tried.num_consistent == 0) return absl::OkStatus();
  MAPP_ASSIGN_OR_RETURN(const std::vector<FrameRecord> frames, reader.ListFrames(view.record.map, view.record.session));
  const auto at =
      std::find_if(frames.begin(), frames.end(), [&](const FrameRecord& f) { return f.id == view.record.id; });
  const auto idx = static_cast<size_t>(at - frames.begin());
  for (size_t i = idx - std::min(idx, kNeighborsAsked); i < std::min(idx + kNeighborsAsked + 1, frames.size()); ++i) {
    if (i == idx) continue;
    MAPP_ASSIGN_OR_RETURN(const FrameView neighbor, LoadFrame(reader, frames[i].id));
    MAPP_RETURN_IF_ERROR(TryKeyframe(reader, neighbor, state.places.index(), *consensus).status());
  }
  return MergeIfDecided(reader, view.record, *consensus, state);
}

}  // namespace mapp
