#pragma once

#include "sim/scene.h"
#include "sim/world/world.h"

#include <span>

namespace mapp::sim {

struct BakeOptions {
  /// Of the light grids' nodes, metres. Smaller gives sharper shadows and takes longer, by the square.
  double spacing_m = 0.5;
  int num_threads = 2;  ///< [1, 256]; the result does not depend on it
};

/// Fills the light grid of each surface, replacing what it held: `ambient`, plus for each light its strength by
/// Lambert's law and its reach where no front of another surface stands in between. Surfaces look equal from all sides,
/// and the light costs nothing when a frame is drawn. Nodes lie at most `spacing_m` apart, at least 2 x 2 a surface.
void BakeLights(Scene& scene, std::span<const Light> lights, double ambient, const BakeOptions& options = {});

}  // namespace mapp::sim
