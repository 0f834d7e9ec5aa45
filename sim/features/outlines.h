#pragma once

#include "sim/features/feature_world.h"
#include "sim/features/observed_surface.h"

#include <cstdint>
#include <span>
#include <unordered_set>
#include <vector>

namespace mapp::sim {

/// Fills FeatureSurface::outline: the vertices of things. Half of what ORB finds in images of a place full of things
/// stands there and not amid a surface: such corners have a strong contrast and look alike at any distance.
void FindOutlines(std::span<FeatureSurface> surfaces);

/// Appends the corners of a surface's outline that are in the image, in each octave in which they are large enough.
/// `seen` holds the ids of the corners that other surfaces showed already.
void FindOutlineCandidates(const FeatureSurface& surface, const FeatureView& view, double border_px,
                           std::unordered_set<uint64_t>& seen, std::vector<FeatureCandidate>& candidates);

}  // namespace mapp::sim
