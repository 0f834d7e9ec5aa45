#pragma once

#include "datasets/sequence.h"

#include <cstddef>
#include <memory>
#include <vector>

namespace mapp {

/// A stretch of a walk through the rendered room: frames `first` to `last` of a session, backwards where last < first.
struct RoomStretch {
  int session = 0;
  size_t first = 0;
  size_t last = 0;

  size_t num_frames() const { return (first < last ? last - first : first - last) + 1; }
};

/// The stretches one after the other as one RGB-D sequence at 15 Hz: from the end of each the device jumps to the
/// beginning of the next. Aborts the test program when the room cannot be drawn.
std::unique_ptr<Sequence> MakeSplicedWalk(const std::vector<RoomStretch>& stretches);

}  // namespace mapp
