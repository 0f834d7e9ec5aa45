#pragma once

#include <opencv2/core/types.hpp>

#include <vector>

namespace mapp::internal {

/// Thins corners to at most `quota`, spread over the image: a quad-tree is split, fullest node first, until it has
/// `quota` leaves, and of each leaf the corner of the greatest response stays (as in ORB-SLAM, Mur-Artal et al. 2015).
/// Deterministic; the order of the result is that of the leaves.
void SpreadCorners(std::vector<cv::KeyPoint>& corners, int width_px, int height_px, int quota);

}  // namespace mapp::internal
