#pragma once

#include "mapp/base/status.h"
#include "sim/world/visit.h"
#include "sim/world/visit_sequence.h"

#include <string>

namespace mapp {

/// A visit of a simulated world, drawn while it plays.
struct VisitSpec {
  sim::SimulationOptions simulation;
  sim::ImageOptions images;
  int user = 0;
};

/// `sim:SETTING/USER` or `sim:SETTING:KEY=VALUE,KEY=VALUE,.../USER`. Keys are the options of `mapp simulate`: users,
/// path, seed, camera, sensor, rate, changes, changes-near, change-kinds, stable, passers, trajectory, textures,
/// routes, max-duration, noise, exposure, motion-blur, exposure-ms; cameras, kinds and files are joined by +. Without
/// `users` there are as many as USER needs. INVALID_ARGUMENT saying which part is wrong and what it could be.
StatusOr<VisitSpec> ParseVisitSpec(const std::string& text);

/// `factor` times a real camera's noise; 0: none, and depth as far as it is drawn.
sim::SensorNoise ScaledNoise(double factor);

}  // namespace mapp
