#pragma once

#include "cli/replay_source.h"
#include "sim/features/feature_world.h"
#include "sim/world/visit.h"

namespace mapp {

/// Plays a visit's features through a device without images. `seed` is of its noise.
std::unique_ptr<ReplaySource> MakeFeatureSource(std::string name, std::shared_ptr<const sim::FeatureWorld> world,
                                                sim::Visit visit, uint64_t seed);

}  // namespace mapp
