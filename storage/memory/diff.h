#pragma once

#include "storage/memory/contents.h"

#include <vector>

namespace mapp::memory {

/// MapReader::DiffRevisions of two states of one map, `before` not later than `after`.
std::vector<SessionDiff> Diff(const MapState& before, const MapState& after);

}  // namespace mapp::memory
