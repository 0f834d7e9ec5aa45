#include "vision/corner_spreading.h"

#include <algorithm>
#include <bit>
#include <cstdint>
#include <utility>

namespace mapp::internal {
namespace {

/// Edge of the cells, in pixels of the level. Smaller cells and shares spread more and repeat less.
constexpr int kCell_px = 64;
constexpr double kMaxEvenShares = 2.5;

/// Sorts corners by contrast; the position, in whole pixels, decides among equals. Sorting numbers instead of corners
/// takes half the time.
void SortStrongestFirst(std::vector<cv::KeyPoint>& corners) {
  struct Entry {
    uint64_t key;
    uint32_t idx;
  };
  std::vector<Entry> entries;
  entries.reserve(corners.size());
  for (size_t i = 0; i < corners.size(); ++i) {
    const cv::KeyPoint& corner = corners[i];
    // The bits of numbers of at least 0 are ordered as the numbers are.
    const uint64_t weakness = ~std::bit_cast<uint32_t>(std::max(corner.response, 0.0F));
    const auto x = static_cast<uint16_t>(corner.pt.x);
    const auto y = static_cast<uint16_t>(corner.pt.y);
    entries.push_back({weakness << 32 | uint64_t{y} << 16 | x, static_cast<uint32_t>(i)});
  }
  std::ranges::sort(entries, {}, &Entry::key);
  std::vector<cv::KeyPoint> sorted;
  sorted.reserve(corners.size());
  for (const Entry& entry : entries) sorted.push_back(corners[entry.idx]);
  corners = std::move(sorted);
}

}  // namespace

void SpreadCorners(std::vector<cv::KeyPoint>& corners, int width_px, int height_px, int quota) {
  SortStrongestFirst(corners);
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
