#pragma once

#include "mapp/base/rng.h"
#include "sim/world/things.h"
#include "sim/world/world.h"

#include <Eigen/Core>

#include <string>
#include <utility>
#include <vector>

namespace mapp::sim {

/// An upright box in the world that nothing else may enter.
struct Solid {
  Eigen::Vector3d center_world;
  Eigen::Vector3d size_m;
  double yaw = 0;
};

/// A place where a changeable thing may come to stand.
struct Spot {
  Eigen::Vector3d ground_world;  ///< below the middle
  double yaw = 0;
  Eigen::Vector3d size_m;  ///< things up to this size fit
};

/// A world in the making: what the settings build with.
class Draft {
 public:
  Draft(const WorldOptions& options, Materials& materials);

  const WorldOptions& options() const { return options_; }
  Materials& materials() { return materials_; }
  Rng& rng() { return rng_; }
  /// Makes surfaces of the surroundings.
  QuadMaker& scenery() { return scenery_; }

  /// Whether a solid keeps `gap_m` from all others and the space asked for stays free.
  bool IsFree(const Solid& solid, double gap_m) const;
  /// Keeps others out of a box.
  void Occupy(const Solid& solid) { solids_.push_back(solid); }
  /// Puts a copy of a thing into the surroundings, unless something is in the way.
  bool TryPut(const Thing& thing, const Eigen::Vector3d& ground_world, double yaw, double gap_m = 0.05);
  /// A thing that may change, unless something is in the way.
  bool TryPutObject(const std::string& kind, uint32_t model, const Thing& thing, const Eigen::Vector3d& ground_world,
                    double yaw, double gap_m = 0.05);
  /// An empty spot, unless something is in the way.
  bool TryAddSpot(const Spot& spot, double gap_m = 0.05);

  /// Adds those of the edges along which every surface and every free spot keeps the routes' clearance, and their
  /// nodes, as far as they hang together. Call when all else stands.
  void AddRoutes(const std::vector<Eigen::Vector3d>& nodes_world, const std::vector<std::pair<size_t, size_t>>& edges);

  World world;
  std::vector<Spot> free_spots;
  std::vector<std::vector<Eigen::Vector3d>> walks_world;  ///< ground that people walk on, as Passer::route_world

 private:
  const WorldOptions& options_;
  Materials& materials_;
  Rng rng_;
  QuadMaker scenery_;
  std::vector<Solid> solids_;
};

// The settings, each in its file.
void BuildGarage(Draft& draft);
void BuildPlaza(Draft& draft);
void BuildHall(Draft& draft);
void BuildCity(Draft& draft);

/// Draws `num_changes` of the draft's objects at times between the visits. INVALID_ARGUMENT: more than objects.
Status AddChanges(const WorldOptions& options, const std::vector<Spot>& free_spots, World& world);

}  // namespace mapp::sim
