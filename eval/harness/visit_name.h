#pragma once

#include "sim/world/visit.h"

#include <string>

namespace mapp {

/// The name by which `mapp replay` plays a visit of a simulated world: `sim:SETTING:KEY=VALUE,.../USER`.
std::string VisitName(const sim::SimulationOptions& options, int user);

}  // namespace mapp
