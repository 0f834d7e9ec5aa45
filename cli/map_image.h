#pragma once

#include "cli/canvas.h"
#include "cli/frame_log.h"
#include "cli/map_info.h"
#include "cli/top_view.h"
#include "mapp/base/status.h"

#include <string>
#include <vector>

namespace mapp {

inline constexpr int kLargestImagePx = 16384;
inline constexpr int kLeastMapWidthPx = 400;
inline constexpr int kLeastMapHeightPx = 300;

struct MapImageOptions {
  int width_px = 1600;   ///< legend included; range [least width of the picture, kLargestImagePx]
  int height_px = 1000;  ///< as the width
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

/// INVALID_ARGUMENT: larger than MapImageOptions says, or smaller than this.
Status Validate(const MapImageOptions& options, int least_width_px, int least_height_px);
/// The points within `area`, as squares: low ones light, high ones dark and on top.
void DrawPoints(const std::vector<MapPointSummary>& points, const TopView& view, const TopView::Viewport& area,
                int size_px, Canvas& canvas);

}  // namespace mapp
