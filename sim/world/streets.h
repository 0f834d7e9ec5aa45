#pragma once

#include "sim/world/draft.h"

#include <Eigen/Core>

namespace mapp::sim {

/// A building over [min.x, max.x] x [min.y, max.y], its ground at min.z.
struct Building {
  Eigen::Vector2d min;
  Eigen::Vector2d max;
  int num_storeys = 4;
  Material facade = Material::kFacadeA;
  bool with_balconies = true;
};

/// How high a building's roof lies above the ground.
double RoofHeight(const Building& building);

/// Shops on the ground floor, storeys of windows with sills and balconies that stand out by up to 0.9 m, a cornice, and
/// a roof with equipment. Occupies its space.
void AddBuilding(const Building& building, Draft& draft);

/// Any of the four facades.
Material AnyFacade(Rng& rng);

}  // namespace mapp::sim
