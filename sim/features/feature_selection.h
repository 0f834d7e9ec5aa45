#pragma once

#include "sim/features/observed_surface.h"

#include <cstdint>
#include <functional>
#include <span>
#include <vector>

namespace mapp::sim {

/// Which of the candidates (indices) are hidden: a batch each call, 1 or 0 per index.
using HiddenTest = std::function<std::vector<uint8_t>(std::span<const size_t>)>;

/// Indices of at most `num_features` candidates that are in plain sight, chosen as OrbExtractor chooses corners: each
/// octave has its share and passes on what it cannot fill; the strongest come first, but a cell of the image takes no
/// more than a few times its even share before all others had their turn. `scores` has one entry per candidate.
std::vector<size_t> SelectFeatures(const Camera& camera, std::span<const FeatureCandidate> candidates,
                                   std::span<const double> scores, int num_features, const HiddenTest& hidden);

}  // namespace mapp::sim
