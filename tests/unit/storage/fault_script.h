#pragma once

#include "storage/map_store.h"

namespace mapp {

inline constexpr int kNumScriptSteps = 40;

/// One change of a fixed sequence that does to a store all that a service does: maps, sessions, keyframes with their
/// points and observations, corrections, fusions, tiles, changes of the world, compaction. It asks the store for what is there, so that it
/// may follow any state, and does alike on any engine. What it leaves is a database in which nothing is wrong.
Status RunScriptStep(MapWriter& writer, int step);

}  // namespace mapp
