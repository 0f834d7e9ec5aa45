#pragma once

#include "cli/replay_source.h"

namespace mapp {

/// Plays images through the built-in tracker.
std::unique_ptr<ReplaySource> MakeImageSource(std::unique_ptr<Sequence> sequence);

}  // namespace mapp
