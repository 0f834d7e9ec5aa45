#include "vision/corner_spreading.h"

#include <algorithm>
#include <tuple>
#include <utility>

namespace mapp::internal {
namespace {

/// Edge of the cells, in pixels of the level. Smaller cells and shares spread more and repeat less.
constexpr int kCell_px = 64;
constexpr double kMaxEvenShares = 2.5;

/// Corners in the order in which they are kept; the position decides among equals.
bool ComesFirst(const cv::KeyPoint& a, const cv::KeyPoint& b) {
  return std::tuple(-a.response, a.pt.y, a.pt.x) < std::tuple(-b.response, b.pt.y, b.pt.x);
}

}  // namespace

void SpreadCorners(std::vector<cv::KeyPoint>& corners, int width_px, int height_px, int quota) {
  std::sort(corners.begin(), corners.end(), ComesFirst);
  if (static_cast<int>(corners.size()) <= quota) return;

  const int columns = std::max(1, width_px / kCell_px);
  const int rows = std::max(1, height_px / kCell_px);
  const int cell_limit = std::max(1, static_cast<int>(kMaxEvenShares * quota / (columns * rows)));
  std::vector<int> cell_counts(static_cast<size_t>(columns * rows), 0);
  std::vector<cv::KeyPoint> kept;
  std::vector<cv::KeyPoint> surplus;
  kept.reserve(corners.size());
  for (const cv::KeyPoint& corner : corners) {
    const int column = std::min(columns - 1, static_cast<int>(corner.pt.x) * columns / width_px);
    const int row = std::min(rows - 1, static_cast<int>(corner.pt.y) * rows / height_px);
    const bool has_room = ++cell_counts[static_cast<size_t>(row * columns + column)] <= cell_limit;
    (has_room ? kept : surplus).push_back(corner);
  }
  kept.insert(kept.end(), surplus.begin(), surplus.end());
  kept.resize(static_cast<size_t>(std::max(0, quota)));
  corners = std::move(kept);
}

}  // namespace mapp::internal
