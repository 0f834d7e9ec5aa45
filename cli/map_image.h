#pragma once

#include "cli/canvas.h"
#include "cli/frame_log.h"
#include "cli/map_info.h"
#include "cli/top_view.h"
#include "mapp/base/status.h"

#include <string>
#include <vector>

namespace mapp {

struct MapImageOptions {
  int width_px = 1600;   ///< range [400, 16384], legend included
  int height_px = 1000;  ///< range [300, 16384]
};

/// What a picture of a map shows.
struct MapImageContent {
  MapContent map;
  std::vector<SessionSummary> sessions;  ///< for the names of devices; others are shown by number
  /// Every frame of some sessions, where a replay has logged them; other sessions are drawn by their keyframes.
  std::vector<FrameLog> logs;
};

/// A PNG of the map from above: points shaded by height, each session's trajectory in a colour of its own with the
/// stretches on a shared map underlaid, keyframes marked as whole, partial or shared, legend and scale bar.
/// INVALID_ARGUMENT: a size out of range.
StatusOr<std::string> DrawMap(const MapImageContent& content, const MapImageOptions& options);

/// INVALID_ARGUMENT: a size out of range.
Status Validate(const MapImageOptions& options);
/// The points within `area`, as squares: low ones light, high ones dark and on top.
void DrawPoints(const std::vector<MapPointSummary>& points, const TopView& view, const TopView::Viewport& area,
                int size_px, Canvas& canvas);

}  // namespace mapp
