#include "server/service/fragment_index.h"

#include <algorithm>

namespace mapp {
namespace {

/// Neighbouring keyframes look alike: so many candidates are asked for that another fragment comes among them.
constexpr size_t kCandidatesPerFragment = 8;

}  // namespace

void FragmentIndex::Add(SessionId session, FrameId frame, std::span<const OrbDescriptor> descriptors) {
  if (!session_of_frame_.emplace(frame.value(), session).second) return;
  index_.Add(frame.value(), descriptors);
  sessions_[session].push_back(frame);
}

void FragmentIndex::Remove(SessionId session) {
  const auto found = sessions_.find(session);
  if (found == sessions_.end()) return;
  for (const FrameId frame : found->second) {
    index_.Remove(frame.value());
    session_of_frame_.erase(frame.value());
  }
  sessions_.erase(found);
}

std::vector<FrameId> FragmentIndex::LookingLike(std::span<const OrbDescriptor> descriptors, size_t max_frames) const {
  std::vector<FrameId> frames;
  std::vector<SessionId> seen;
  for (const PlaceIndex::Candidate& candidate : index_.Query(descriptors, kCandidatesPerFragment * max_frames)) {
    const SessionId session = session_of_frame_.at(candidate.frame);
    if (std::find(seen.begin(), seen.end(), session) != seen.end()) continue;
    seen.push_back(session);
    frames.emplace_back(candidate.frame);
    if (frames.size() == max_frames) break;
  }
  return frames;
}

}  // namespace mapp
