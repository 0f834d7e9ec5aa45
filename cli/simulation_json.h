#pragma once

#include "sim/world/visit.h"

#include <string>

namespace mapp {

/// The options that make the simulation again, the world's extent and the visits, as JSON.
std::string FormatSimulation(const sim::Simulation& simulation);
/// The folder of a user's visit, below that of the simulation.
std::string VisitFolder(int user);

}  // namespace mapp
