#pragma once

#include "storage/records.h"

#include <cstdint>
#include <limits>

namespace mapp {

/// Frames of a session that are not to vouch for its own place: all of them, while it looks for the others' map; those
/// next to a keyframe, when it may have come back to where it was before.
struct OwnFrames {
  SessionId session;  ///< SessionId(): none
  uint32_t first_number = 0;
  uint32_t last_number = std::numeric_limits<uint32_t>::max();

  bool Contains(const FrameRecord& frame) const {
    return frame.session == session && frame.number >= first_number && frame.number <= last_number;
  }
};

}  // namespace mapp
