#pragma once

#include <opencv2/core/types.hpp>

#include <vector>

namespace mapp::internal {

/// Thins corners to at most `quota`: strongest first, but a square cell of the image takes no more than a few times its
/// even share before all other cells had their turn. Deterministic; strongest first within both turns.
///
/// Keeping one corner per leaf of a quad-tree, as ORB-SLAM does, spreads further but finds fewer of the same corners
/// again: on recorded RGB-D rooms 185 correct matches a third of a second apart against 265 by this rule and 270 by the
/// globally strongest corners, which in turn cover a fifth less of the image.
void SpreadCorners(std::vector<cv::KeyPoint>& corners, int width_px, int height_px, int quota);

}  // namespace mapp::internal
