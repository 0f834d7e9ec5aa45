#pragma once

#include "mapp/base/id.h"
#include "mapp/feature/feature.h"
#include "vision/place_index.h"

#include <map>
#include <span>
#include <unordered_map>
#include <vector>

namespace mapp {

/// The keyframes of fragments by their looks. A fragment that found no place in the map is remembered here, so that it
/// is tried again when the map grows to where it was. Thread-compatible.
class FragmentIndex {
 public:
  bool empty() const { return sessions_.empty(); }
  void Add(SessionId session, FrameId frame, std::span<const OrbDescriptor> descriptors);
  /// Forgets a fragment: it has merged.
  void Remove(SessionId session);
  /// Keyframes that look most like a view, best first, at most `max_frames` and one of each fragment.
  std::vector<FrameId> LookingLike(std::span<const OrbDescriptor> descriptors, size_t max_frames) const;

 private:
  PlaceIndex index_{PlaceIndex::Options{}};
  std::unordered_map<uint64_t, SessionId> session_of_frame_;
  std::map<SessionId, std::vector<FrameId>> sessions_;
};

}  // namespace mapp
