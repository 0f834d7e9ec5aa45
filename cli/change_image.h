#pragma once

#include "cli/changed_map.h"
#include "cli/map_image.h"
#include "mapp/base/status.h"

#include <string>

namespace mapp {

/// With less room the legend would not fit, nor two pictures beside it.
inline constexpr int kLeastChangesWidthPx = 800;
inline constexpr int kLeastChangesHeightPx = 500;

/// A PNG of the map from above, as DrawMap sees it, with its changes: points in grey, those of what vanished, appeared
/// or moved in the changes' colors, boxes as turned outlines with the change's id, arrows along what moved, legend and
/// scale bar. INVALID_ARGUMENT: a size out of range.
StatusOr<std::string> DrawChanges(const ChangedMap& map, const MapImageOptions& options);

/// Two such pictures side by side, around the changes: the world before them, and after. What is not there in one of
/// them is outlined in a pale color.
StatusOr<std::string> DrawBeforeAndAfter(const ChangedMap& map, const MapImageOptions& options);

}  // namespace mapp
