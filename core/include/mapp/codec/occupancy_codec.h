#pragma once

#include "mapp/base/status.h"
#include "mapp/view/occupancy.h"

#include <string>
#include <string_view>

namespace mapp {

/// Occupied bins of a view, entropy coded (docs/formats/query.md).
std::string EncodeOccupancy(const OccupancyGrid& grid);
/// `sketch`: that of the query. INVALID_ARGUMENT when the bytes do not describe its bins.
StatusOr<OccupancyGrid> DecodeOccupancy(std::string_view bytes, const DepthSketch& sketch);

}  // namespace mapp
