#pragma once

#include "mapp/geometry/oriented_box.h"

#include <Eigen/Core>

#include <array>
#include <vector>

namespace mapp {

/// The corners of a box, in the frame that it is told in.
std::array<Eigen::Vector3d, 8> CornersOf(const OrientedBox& box);

/// The corners of the smallest convex polygon around the points, counterclockwise where the second axis is a quarter
/// turn counterclockwise from the first; those on its sides left out. Begins with the one lowest along the first axis.
std::vector<Eigen::Vector2d> ConvexHull(std::vector<Eigen::Vector2d> points);

}  // namespace mapp
