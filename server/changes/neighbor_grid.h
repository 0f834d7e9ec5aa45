#pragma once

#include "mapp/geometry/neighbor_grid.h"  // IWYU pragma: export
