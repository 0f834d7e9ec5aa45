#pragma once

#include "mapp/base/status.h"
#include "sim/world/visit.h"

#include <string>

namespace mapp {

/// A PNG of a simulated world from above, x to the right and y up: outlines of what stands there, objects and what
/// becomes of them, each user's way in a colour of its own, legend and scale bar.
StatusOr<std::string> DrawWorld(const sim::Simulation& simulation);

}  // namespace mapp
