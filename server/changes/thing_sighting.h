#pragma once

#include "server/changes/point_tiles.h"
#include "server/changes/presence.h"
#include "server/changes/witness_views.h"

#include <Eigen/Core>

#include <cstddef>
#include <span>
#include <vector>

namespace mapp {

/// What one view says of a thing as a whole: its own points whose rays pass through the thing's outline.
struct ThingSighting {
  double outline_area = 0;  ///< of the hull, in units of (x/z, y/z)
  size_t num_hits = 0;      ///< end where the thing is
  size_t num_passed = 0;    ///< go on beyond it
  size_t num_blocked = 0;   ///< end before it
};

/// Compares the rays of a view with the thing's silhouette, the convex hull of its points as the view sees them: what
/// is thinner than the gaps between a view's points is told from what is gone, since no ray passes through it. Zeros
/// where the view sees too few of the points, or not from where they were seen.
ThingSighting SightThing(const WitnessView& view, std::span<const Eigen::Vector3f> p_map,
                         std::span<const Eigen::Vector3f> directions);

}  // namespace mapp
