#include "sim/world/streets.h"

#include <array>
#include <cmath>

namespace mapp::sim {
namespace {

constexpr double kShop_m = 3.4;
constexpr double kStorey_m = 3.0;
constexpr double kParapet_m = 0.5;

/// One side of a building, seen from the street: from `left` to `right` on the ground.
void AddSide(const Building& building, const Eigen::Vector3d& left, const Eigen::Vector3d& right, Draft& draft) {
  constexpr double kBalcony_m = 0.8;
  QuadMaker& maker = draft.scenery();
  Rng& rng = draft.rng();
  const double storeys_m = building.num_storeys * kStorey_m - kStorey_m;
  const Eigen::Vector3d above_shops(0, 0, kShop_m);
  maker.Facade(UprightRect(left, right, kShop_m), Material::kShops);
  maker.Facade(UprightRect(left + above_shops, right + above_shops, storeys_m), building.facade);
  const Eigen::Vector3d along = (right - left).normalized();
  const Eigen::Vector3d outwards(along.y(), -along.x(), 0);
  const double yaw = std::atan2(along.y(), along.x());
  const double length_m = (right - left).norm();
  // A ledge over the shops and a cornice under the roof.
  const BoxLook ledge{Material::kPlaster, Material::kPlaster, false, true};
  for (const double z : {kShop_m, kShop_m + storeys_m}) {
    maker.Box(left + 0.5 * (right - left) + 0.12 * outwards + Eigen::Vector3d(0, 0, z), {length_m, 0.24, 0.22}, yaw,
              ledge);
  }
  const int num_bays = std::max(static_cast<int>(std::lround(length_m / kStorey_m)), 1);
  const double bay_m = length_m / num_bays;
  const uint64_t every = 2 + rng.Below(2);  // balconies stand in columns
  for (int bay = 0; building.with_balconies && bay < num_bays; ++bay) {
    if (static_cast<uint64_t>(bay) % every != 0) continue;
    for (int storey = 0; storey + 1 < building.num_storeys; ++storey) {
      const Eigen::Vector3d middle = left + (bay + 0.5) * bay_m * along + 0.5 * kBalcony_m * outwards +
                                     Eigen::Vector3d(0, 0, kShop_m + storey * kStorey_m + 0.5);
      maker.Box(middle, {0.75 * bay_m, kBalcony_m, 0.75}, yaw, {Material::kSheetMetal, Material::kPlanks, false, true});
    }
  }
  for (int i = 0; i < 2; ++i) {  // boards that stand out over the shops
    const Eigen::Vector3d at = left + rng.Uniform(0.15, 0.85) * (right - left) + Eigen::Vector3d(0, 0, 2.6);
    const Eigen::Vector3d tip = at + 0.8 * outwards;
    maker.Hang(UprightRect(at, tip, 0.7), Material::kPoster);
    maker.Hang(UprightRect(tip, at, 0.7), Material::kPoster);
  }
}

void AddRoof(const Building& building, Draft& draft) {
  QuadMaker& maker = draft.scenery();
  Rng& rng = draft.rng();
  const double roof_m = RoofHeight(building) - kParapet_m;
  const Eigen::Vector2d size_m = building.max - building.min;
  const Eigen::Vector2d center = 0.5 * (building.min + building.max);
  maker.Panels(FloorRect({building.min.x(), building.min.y(), roof_m}, {building.max.x(), building.max.y(), roof_m}),
               Material::kRoof);
  const BoxLook wall{Material::kPlaster, Material::kConcrete};
  for (const double side : {-0.5, 0.5}) {
    maker.Box({center.x(), center.y() + side * (size_m.y() - 0.3), roof_m + 0.5 * kParapet_m},
              {size_m.x(), 0.3, kParapet_m}, 0, wall);
    maker.Box({center.x() + side * (size_m.x() - 0.3), center.y(), roof_m + 0.5 * kParapet_m},
              {0.3, size_m.y(), kParapet_m}, 0, wall);
  }
  const auto num_things = static_cast<int>(2 + 0.03 * size_m.x() * size_m.y());
  for (int i = 0; i < num_things; ++i) {
    const Eigen::Vector3d box_m(rng.Uniform(0.6, 2.2), rng.Uniform(0.6, 1.6), rng.Uniform(0.5, 1.3));
    constexpr std::array kLooks = {Material::kMachine, Material::kSheetMetal, Material::kMasonry, Material::kPanes};
    const Material look = kLooks.at(rng.Below(kLooks.size()));
    draft.TryPut(MakeBox(box_m, {look, Material::kPlates, look == Material::kMachine, false}, draft.materials(), rng),
                 {rng.Uniform(building.min.x() + 1.6, building.max.x() - 1.6),
                  rng.Uniform(building.min.y() + 1.6, building.max.y() - 1.6), roof_m},
                 0, 0.3);
  }
}

}  // namespace

double RoofHeight(const Building& building) { return kShop_m + (building.num_storeys - 1) * kStorey_m + kParapet_m; }

Material AnyFacade(Rng& rng) {
  constexpr std::array kFacades = {Material::kFacadeA, Material::kFacadeB, Material::kFacadeC, Material::kFacadeD};
  return kFacades.at(rng.Below(kFacades.size()));
}

void AddBuilding(const Building& building, Draft& draft) {
  const double roof_m = RoofHeight(building) - kParapet_m;
  const Eigen::Vector3d a(building.min.x(), building.min.y(), 0), b(building.max.x(), building.min.y(), 0);
  const Eigen::Vector3d c(building.max.x(), building.max.y(), 0), d(building.min.x(), building.max.y(), 0);
  AddSide(building, a, b, draft);
  AddSide(building, b, c, draft);
  AddSide(building, c, d, draft);
  AddSide(building, d, a, draft);
  draft.Occupy({0.5 * (a + c) + Eigen::Vector3d(0, 0, 0.5 * roof_m), c - a + Eigen::Vector3d(0, 0, roof_m), 0});
  AddRoof(building, draft);
}

}  // namespace mapp::sim
