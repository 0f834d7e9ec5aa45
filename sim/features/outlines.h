#pragma once

#include "sim/features/feature_world.h"
#include "sim/features/observed_surface.h"

#include <cstdint>
#include <span>
#include <vector>

namespace mapp::sim {

/// Fills FeatureSurface::outline: the vertices of things. Half of what ORB finds in images of a place full of things
/// stands there and not amid a surface: such corners have a strong contrast and look alike at any distance. Returns how
/// many there are.
uint32_t FindOutlines(std::span<FeatureSurface> surfaces);

/// Appends the corners of a surface's outline that are in the image, in each octave in which they are large enough.
/// `seen`, one entry for each of the scene's, marks the corners that other surfaces showed already.
void FindOutlineCandidates(const FeatureSurface& surface, const FeatureView& view, double border_px,
                           std::vector<bool>& seen, std::vector<FeatureCandidate>& candidates);

}  // namespace mapp::sim
