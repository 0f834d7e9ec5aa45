#pragma once

#include "sim/world/world.h"

namespace mapp::sim::test {

/// Streets `step_m` apart that cross, and a dead end; 1.5 m above the ground.
inline RouteGraph StreetGrid(size_t columns = 5, size_t rows = 4, double step_m = 10) {
  RouteGraph graph;
  graph.clearance_m = 0.5;
  for (size_t row = 0; row < rows; ++row) {
    for (size_t column = 0; column < columns; ++column) {
      const size_t node = graph.nodes_world.size();
      graph.nodes_world.emplace_back(step_m * static_cast<double>(column), step_m * static_cast<double>(row), 1.5);
      if (column > 0) graph.edges.emplace_back(node - 1, node);
      if (row > 0) graph.edges.emplace_back(node - columns, node);
    }
  }
  graph.nodes_world.emplace_back(-step_m, 0, 1.5);
  graph.edges.emplace_back(0, graph.nodes_world.size() - 1);
  return graph;
}

/// The streets alone, without anything to see.
inline World StreetWorld() {
  World world;
  world.setting = "garage";
  world.routes = StreetGrid();
  world.bounds_world = Aabb(Eigen::Vector3d(-12, -2, 0), Eigen::Vector3d(42, 32, 3));
  return world;
}

}  // namespace mapp::sim::test
