#pragma once

#include "cli/replay_source.h"
#include "datasets/sequence.h"
#include "mapp/base/status.h"
#include "mapp/client/orb_tracker.h"

#include <memory>

namespace mapp {

/// The built-in tracker for a sequence's sensors. INVALID_ARGUMENT: a sensor that it cannot use.
StatusOr<std::unique_ptr<OrbTracker>> MakeTracker(const Sequence& sequence);

/// Plays images through the built-in tracker.
std::unique_ptr<ReplaySource> MakeImageSource(std::unique_ptr<Sequence> sequence);

}  // namespace mapp
