#pragma once

#include "sim/world/quad_maker.h"

#include <Eigen/Core>

#include <cstddef>
#include <vector>

namespace mapp::sim {

/// A thing to be put somewhere. Its frame lies on the ground below its middle, z up; `size_m` is its box.
struct Thing {
  std::vector<Quad> quads;
  Eigen::Vector3d size_m = Eigen::Vector3d::Zero();
};

/// A plain box on the ground.
Thing MakeBox(const Eigen::Vector3d& size_m, const BoxLook& look, Materials& materials, Rng& rng);
/// A bench along x.
Thing MakeBench(Materials& materials, Rng& rng);
/// A sales stand with a roof and pictures on its sides.
Thing MakeKiosk(const Eigen::Vector3d& size_m, Materials& materials, Rng& rng);
/// A planted tub.
Thing MakePlanter(Materials& materials, Rng& rng);
/// A lamp on a pole.
Thing MakeLampPost(double height_m, Materials& materials, Rng& rng);
/// A trunk and crossed planes of leaves.
Thing MakeTree(double height_m, Materials& materials, Rng& rng);
/// A machine in a hall, of a base, a body with panels, a ladder and pipes.
Thing MakeMachine(const Eigen::Vector3d& size_m, Materials& materials, Rng& rng);
/// Shelves of goods along x.
Thing MakeRack(const Eigen::Vector3d& size_m, Materials& materials, Rng& rng);
/// Cartons stacked on each other.
Thing MakeCartons(Materials& materials, Rng& rng);
/// A standing person who looks along +x.
Thing MakePerson(Materials& materials, Rng& rng);

/// How many car models there are; cars of one model are equal.
inline constexpr size_t kNumCarModels = 12;
/// No car is larger.
inline const Eigen::Vector3d kLargestCar_m(4.9, 1.95, 2.0);
/// A parked car, nose along +x. `model` < kNumCarModels.
Thing MakeCar(size_t model, uint64_t seed);

}  // namespace mapp::sim
