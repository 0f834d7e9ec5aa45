#include "sim/world/things.h"

#include <algorithm>
#include <cmath>
#include <numbers>

namespace mapp::sim {

Thing MakeBox(const Eigen::Vector3d& size_m, const BoxLook& look, Materials& materials, Rng& rng) {
  Thing thing;
  thing.size_m = size_m;
  QuadMaker(materials, rng, thing.quads).Box({0, 0, 0.5 * size_m.z()}, size_m, 0, look);
  return thing;
}

Thing MakeBench(Materials& materials, Rng& rng) {
  Thing thing;
  thing.size_m = {1.8, 0.6, 0.9};
  QuadMaker maker(materials, rng, thing.quads);
  const BoxLook wood{Material::kPlanks, Material::kPlanks, false, true};
  maker.Box({0, 0, 0.44}, {1.8, 0.5, 0.06}, 0, wood);
  maker.Box({0, 0.27, 0.7}, {1.8, 0.05, 0.4}, 0, wood);
  for (const double x_m : {-0.75, 0.75}) {
    maker.Box({x_m, 0, 0.205}, {0.1, 0.45, 0.41}, 0, {Material::kConcrete, Material::kConcrete});
  }
  return thing;
}

Thing MakeKiosk(const Eigen::Vector3d& size_m, Materials& materials, Rng& rng) {
  constexpr double kRoof_m = 0.2;
  Thing thing;
  thing.size_m = size_m;
  QuadMaker maker(materials, rng, thing.quads);
  const double wall_m = size_m.z() - kRoof_m;
  maker.Box({0, 0, 0.5 * wall_m}, {size_m.x() - 0.5, size_m.y() - 0.5, wall_m}, 0,
            {Material::kShops, Material::kRoof, true, false});
  maker.Box({0, 0, wall_m + 0.5 * kRoof_m}, {size_m.x(), size_m.y(), kRoof_m}, 0,
            {Material::kStripes, Material::kRoof, false, true});
  return thing;
}

Thing MakePlanter(Materials& materials, Rng& rng) {
  Thing thing;
  thing.size_m = {1.4, 1.4, 1.5};
  QuadMaker maker(materials, rng, thing.quads);
  maker.Box({0, 0, 0.3}, {1.4, 1.4, 0.6}, 0, {Material::kConcrete, Material::kFoliage});
  maker.Box({0, 0, 1.05}, {1.1, 1.1, 0.9}, rng.Uniform(0, 0.2), {Material::kFoliage, Material::kFoliage});
  return thing;
}

Thing MakeLampPost(double height_m, Materials& materials, Rng& rng) {
  Thing thing;
  thing.size_m = {0.9, 0.5, height_m};
  QuadMaker maker(materials, rng, thing.quads);
  const BoxLook metal{Material::kPlates, Material::kPlates, false, true};
  maker.Box({0, 0, 0.3}, {0.4, 0.4, 0.6}, 0, {Material::kConcrete, Material::kConcrete});
  maker.Box({0, 0, 0.5 * height_m}, {0.14, 0.14, height_m}, 0, metal);
  maker.Box({0, 0, height_m - 0.15}, {0.9, 0.3, 0.12}, 0, {Material::kTube, Material::kPlates, true, true});
  maker.Hang(UprightRect({-0.25, -0.09, 1.8}, {0.25, -0.09, 1.8}, 0.6), Material::kPoster);
  maker.Hang(UprightRect({0.25, 0.09, 1.8}, {-0.25, 0.09, 1.8}, 0.6), Material::kPoster);
  return thing;
}

Thing MakeTree(double height_m, Materials& materials, Rng& rng) {
  Thing thing;
  const double crown_m = 0.55 * height_m;
  thing.size_m = {crown_m, crown_m, height_m};
  QuadMaker maker(materials, rng, thing.quads);
  maker.Box({0, 0, 0.25 * height_m}, {0.3, 0.3, 0.5 * height_m}, 0, {Material::kPlanks, Material::kPlanks});
  const BoxLook leaves{Material::kFoliage, Material::kFoliage, false, true};
  const double side_m = 0.68 * crown_m;  // turned by an eighth it still stays in the tree's box
  maker.Box({0, 0, height_m - 0.3 * crown_m}, {side_m, side_m, 0.6 * crown_m}, rng.Uniform(0, 0.7), leaves);
  maker.Box({0, 0, height_m - 0.5 * crown_m}, {side_m, side_m, 0.55 * crown_m}, std::numbers::pi / 4, leaves);
  maker.Box({0, 0, height_m - 0.45 * crown_m}, {0.9 * crown_m, 0.55 * crown_m, 0.4 * crown_m}, 0, leaves);
  maker.Box({0, 0, height_m - 0.55 * crown_m}, {0.55 * crown_m, 0.9 * crown_m, 0.4 * crown_m}, 0, leaves);
  return thing;
}

Thing MakeMachine(const Eigen::Vector3d& size_m, Materials& materials, Rng& rng) {
  constexpr double kBase_m = 0.25;
  Thing thing;
  thing.size_m = size_m;
  QuadMaker maker(materials, rng, thing.quads);
  maker.Box({0, 0, 0.5 * kBase_m}, {size_m.x(), size_m.y(), kBase_m}, 0, {Material::kStripes, Material::kPlates});
  const double body_m = rng.Uniform(0.5, 0.75) * size_m.z();
  const Eigen::Vector3d body(size_m.x() - 0.2, size_m.y() - 0.2, body_m - kBase_m);
  maker.Box({0, 0, kBase_m + 0.5 * body.z()}, body, 0, {Material::kMachine, Material::kPlates, body.x() < 3, false});
  // A tower at one end, and a drum with pipes at the other.
  const double tower_m = rng.Uniform(0.3, 0.5) * body.x();
  const double side = rng.Uniform() < 0.5 ? -1 : 1;
  maker.Box({side * 0.5 * (body.x() - tower_m), 0, 0.5 * (body_m + size_m.z())},
            {tower_m, 0.8 * body.y(), size_m.z() - body_m}, 0, {Material::kMachine, Material::kPlates, true, false});
  const BoxLook pipe{Material::kSheetMetal, Material::kSheetMetal, false, true};
  const double rest_m = body.x() - tower_m;
  const double rest_at_m = -side * 0.5 * (body.x() - rest_m);
  const double head_m = size_m.z() - body_m;
  maker.Box({rest_at_m, 0, body_m + 0.25 * head_m}, {0.7 * rest_m, 0.5 * body.y(), 0.5 * head_m}, 0,
            {Material::kPlates, Material::kPlates});
  for (const double y : {-0.32, 0.32}) {
    maker.Box({rest_at_m, y * body.y(), body_m + 0.7 * head_m}, {rest_m, 0.14, 0.14}, 0, pipe);
    maker.Box({rest_at_m, y * body.y(), body_m + 0.32 * head_m}, {0.14, 0.14, 0.63 * head_m}, 0, pipe);
  }
  const double ladder_at_m = side * rng.Uniform(0.1, 0.35) * body.x();
  const double front_m = 0.5 * body.y() + 0.03;
  maker.Hang(UprightRect({ladder_at_m - 0.22, -front_m, kBase_m}, {ladder_at_m + 0.22, -front_m, kBase_m}, body.z()),
             Material::kLadder);
  const double plate_at_m = -ladder_at_m;
  maker.Hang(UprightRect({plate_at_m + 0.3, front_m, 1.0}, {plate_at_m - 0.3, front_m, 1.0},
                         std::min(0.8, std::max(body.z() - 0.9, 0.1))),
             Material::kPoster);
  return thing;
}

Thing MakeRack(const Eigen::Vector3d& size_m, Materials& materials, Rng& rng) {
  Thing thing;
  thing.size_m = size_m;
  QuadMaker maker(materials, rng, thing.quads);
  const BoxLook frame{Material::kSheetMetal, Material::kPlates, false, true};
  for (const double x : {-0.5, 0.5}) {
    maker.Box({x * (size_m.x() - 0.08), 0, 0.5 * size_m.z()}, {0.08, size_m.y(), size_m.z()}, 0, frame);
  }
  const auto num_shelves = std::max(static_cast<int>(size_m.z() / 0.85), 1);
  const double step_m = size_m.z() / num_shelves;
  for (int shelf = 0; shelf < num_shelves; ++shelf) {
    const double floor_m = 0.1 + shelf * step_m;
    maker.Box({0, 0, floor_m}, {size_m.x() - 0.16, size_m.y(), 0.06}, 0,
              {Material::kPlanks, Material::kPlanks, false, true});
    for (double x_m = -0.5 * size_m.x() + 0.15; x_m < 0.5 * size_m.x() - 0.5;) {
      const double wide_m = std::min(rng.Uniform(0.35, 0.8), 0.5 * size_m.x() - 0.1 - x_m);
      const double tall_m = rng.Uniform(0.4, 0.85) * (step_m - 0.1);
      if (rng.Uniform() < 0.85) {
        maker.Box({x_m + 0.5 * wide_m, 0, floor_m + 0.03 + 0.5 * tall_m},
                  {wide_m - 0.05, rng.Uniform(0.7, 0.95) * size_m.y(), tall_m}, 0,
                  {rng.Uniform() < 0.3 ? Material::kGoods : Material::kCarton, Material::kCarton, true, false});
      }
      x_m += wide_m;
    }
  }
  return thing;
}

Thing MakeCartons(Materials& materials, Rng& rng) {
  Thing thing;
  const Eigen::Vector3d size_m(rng.Uniform(0.7, 1.2), rng.Uniform(0.7, 1.0), rng.Uniform(0.9, 1.6));
  thing.size_m = size_m;
  QuadMaker maker(materials, rng, thing.quads);
  const BoxLook carton{Material::kCarton, Material::kCarton, true, false};
  const double low_m = rng.Uniform(0.45, 0.65) * size_m.z();
  maker.Box({0, 0, 0.06}, {size_m.x(), size_m.y(), 0.12}, 0, {Material::kPlanks, Material::kPlanks});
  maker.Box({0, 0, 0.12 + 0.5 * (low_m - 0.12)}, {0.94 * size_m.x(), 0.94 * size_m.y(), low_m - 0.12}, 0, carton);
  maker.Box({0.04, -0.03, 0.5 * (low_m + size_m.z())}, {0.7 * size_m.x(), 0.7 * size_m.y(), size_m.z() - low_m},
            rng.Uniform(-0.15, 0.15), carton);
  return thing;
}

Thing MakePerson(Materials& materials, Rng& rng) {
  const double height_m = rng.Uniform(1.6, 1.9);
  Thing thing;
  thing.size_m = {0.5, 0.55, height_m};
  QuadMaker maker(materials, rng, thing.quads);
  const BoxLook cloth{Material::kClothes, Material::kClothes, true, true};
  const double hip_m = 0.48 * height_m;
  const double neck_m = 0.84 * height_m;
  maker.Box({0.1, -0.11, 0.5 * hip_m}, {0.17, 0.16, hip_m}, 0, cloth);
  maker.Box({-0.1, 0.11, 0.5 * hip_m}, {0.17, 0.16, hip_m}, 0, cloth);
  maker.Box({0, 0, 0.5 * (hip_m + neck_m)}, {0.26, 0.46, neck_m - hip_m}, 0, cloth);
  maker.Box({0, 0, 0.5 * (neck_m + height_m)}, {0.21, 0.18, height_m - neck_m}, 0, cloth);
  return thing;
}

}  // namespace mapp::sim
