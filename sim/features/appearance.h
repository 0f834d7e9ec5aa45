#pragma once

#include "mapp/base/rng.h"
#include "mapp/feature/feature.h"
#include "sim/features/feature_camera.h"
#include "sim/features/observed_surface.h"

#include <cstdint>

namespace mapp::sim {

/// How a landmark looks in an image: what of its descriptor follows from the view is the same each time, the rest comes
/// from `rng`.
OrbDescriptor Describe(const FeatureCandidate& candidate, const FeatureView& view, const FeatureNoise& noise, Rng& rng);

/// Direction of the corner's orientation in the image, radians.
float ImageAngle(const FeatureCandidate& candidate, const FeatureView& view);

/// Looks of outlines' corners: of a corner of equal things, `thing`, at one place, `place`. Few of them can be told
/// apart for certain, as in images.
OrbDescriptor OutlineDescriptor(uint64_t thing, uint64_t place);

}  // namespace mapp::sim
