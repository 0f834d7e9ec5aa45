#include "sim/world/streets.h"

#include <array>
#include <cmath>
#include <limits>
#include <numbers>

// A small city of 80 x 75 m for drones: three by three blocks of houses of three to six storeys, the one in the middle
// a park, between streets with parked cars, trees and lamps. Houses beyond close the streets' ends.

namespace mapp::sim {
namespace {

constexpr double kHalfLength_m = 40;
constexpr double kHalfWidth_m = 37.5;
constexpr double kTop_m = 24;
constexpr double kPavement_m = 2.0;
constexpr double kMark_m = 0.004;
/// Borders of the blocks; streets lie between the second and third, and the fourth and fifth.
constexpr std::array<double, 6> kBlocks_x = {-40, -23.5, -11.5, 11.5, 23.5, 40};
constexpr std::array<double, 6> kBlocks_y = {-37.5, -22.5, -11, 11, 22.5, 37.5};
constexpr std::array<double, 2> kStreets_x = {-17.5, 17.5};
constexpr std::array<double, 2> kStreets_y = {-16.75, 16.75};
constexpr std::array<double, 4> kHeights_m = {3.2, 6.5, 10, 14.5};  ///< that drones fly at

class City {
 public:
  explicit City(Draft& draft) : draft_(draft), maker_(draft.scenery()) {}

  void Build() {
    World& world = draft_.world;
    world.bounds_world =
        Aabb(Eigen::Vector3d(-kHalfLength_m, -kHalfWidth_m, 0), Eigen::Vector3d(kHalfLength_m, kHalfWidth_m, kTop_m));
    world.sky_gray = 225;
    world.ambient = 0.62;
    world.lights.push_back({{-1100, -1000, 1900}, 0.5, std::numeric_limits<double>::infinity()});
    world.routes.clearance_m = 1.0;
    AddGround();
    AddBlocks();
    AddBorder();
    AddPark();
    AddStreetFurniture();
    AddCars();
    AddWays();
  }

 private:
  void AddGround() {
    constexpr double kBeyond_m = 10;
    maker_.Panels(FloorRect({-kHalfLength_m - kBeyond_m, -kHalfWidth_m - kBeyond_m, 0},
                            {kHalfLength_m + kBeyond_m, kHalfWidth_m + kBeyond_m, 0}),
                  Material::kAsphalt);
    // Pavements around the blocks, 12 cm high.
    for (size_t i = 0; i < kBlocks_x.size(); i += 2) {
      for (size_t j = 0; j < kBlocks_y.size(); j += 2) {
        const Eigen::Vector3d min(kBlocks_x[i] - (i > 0 ? kPavement_m : 0), kBlocks_y[j] - (j > 0 ? kPavement_m : 0),
                                  0);
        const Eigen::Vector3d max(kBlocks_x[i + 1] + (i < 4 ? kPavement_m : 0),
                                  kBlocks_y[j + 1] + (j < 4 ? kPavement_m : 0), 0.12);
        maker_.Panels(FloorRect({min.x(), min.y(), 0.12}, max), Material::kPaving);
        const std::array<Eigen::Vector3d, 5> corners = {min, Eigen::Vector3d(max.x(), min.y(), 0),
                                                        Eigen::Vector3d(max.x(), max.y(), 0),
                                                        Eigen::Vector3d(min.x(), max.y(), 0), min};
        for (size_t k = 0; k + 1 < corners.size(); ++k) {
          maker_.Panels(UprightRect(corners[k], corners[k + 1], 0.12), Material::kConcrete);
        }
      }
    }
    for (const double x : kStreets_x) {
      for (double y = -36; y < 35; y += 4) Mark({x - 0.06, y}, {x + 0.06, y + 2});
      for (const double y : {-9.0, 9.0}) Crossing(x, y);
    }
    for (const double y : kStreets_y) {
      for (double x = -38; x < 37; x += 4) Mark({x, y - 0.06}, {x + 2, y + 0.06});
    }
  }

  void Mark(const Eigen::Vector2d& min, const Eigen::Vector2d& max) {
    const Rect rect = FloorRect({min.x(), min.y(), kMark_m}, {max.x(), max.y(), kMark_m});
    maker_.Hang(rect, Material::kRoadLine);
  }

  /// Stripes for walkers across a street along y.
  void Crossing(double x, double y) {
    for (double at = x - 3.6; at < x + 3.6; at += 1.0) {
      const Rect stripe = FloorRect({at, y - 1.5, kMark_m}, {at + 0.5, y + 1.5, kMark_m});
      maker_.Hang({stripe.corner + stripe.edge_u, stripe.edge_v, -stripe.edge_u}, Material::kRoadLine);
    }
  }

  /// Each block in two or three houses.
  void AddBlocks() {
    Rng& rng = draft_.rng();
    for (size_t i = 0; i < kBlocks_x.size(); i += 2) {
      for (size_t j = 0; j < kBlocks_y.size(); j += 2) {
        if (i == 2 && j == 2) continue;  // the park
        const Eigen::Vector2d min(kBlocks_x[i], kBlocks_y[j]), max(kBlocks_x[i + 1], kBlocks_y[j + 1]);
        const bool along_x = max.x() - min.x() > max.y() - min.y();
        const double length_m = along_x ? max.x() - min.x() : max.y() - min.y();
        const double cut_m = length_m * rng.Uniform(0.4, 0.6);
        Eigen::Vector2d first_max = max, second_min = min;
        first_max[along_x ? 0 : 1] = min[along_x ? 0 : 1] + cut_m;
        second_min[along_x ? 0 : 1] = first_max[along_x ? 0 : 1] + 0.02;
        // One low and one high house a block: drones may pass over the low one.
        const bool low_first = rng.Uniform() < 0.5;
        const int low = 3, high = 4 + static_cast<int>(rng.Below(3));
        AddBuilding({min, first_max, low_first ? low : high, AnyFacade(rng), rng.Uniform() < 0.7}, draft_);
        AddBuilding({second_min, max, low_first ? high : low, AnyFacade(rng), rng.Uniform() < 0.7}, draft_);
      }
    }
  }

  /// Facades of many heights beyond the bounds, so that streets do not end in nothing.
  void AddBorder() {
    const double x = kHalfLength_m + 8, y = kHalfWidth_m + 8;
    const std::array<Eigen::Vector3d, 5> corners = {Eigen::Vector3d(-x, -y, 0), Eigen::Vector3d(-x, y, 0),
                                                    Eigen::Vector3d(x, y, 0), Eigen::Vector3d(x, -y, 0),
                                                    Eigen::Vector3d(-x, -y, 0)};
    Rng& rng = draft_.rng();
    for (size_t i = 0; i + 1 < corners.size(); ++i) {
      constexpr int kHouses = 7;
      const Eigen::Vector3d step = (corners.at(i + 1) - corners.at(i)) / kHouses;
      for (int house = 0; house < kHouses; ++house) {
        const Eigen::Vector3d left = corners.at(i) + house * step;
        maker_.Facade(UprightRect(left, left + step, 3.0 * static_cast<double>(5 + rng.Below(4))), AnyFacade(rng));
      }
    }
  }

  void AddPark() {
    Materials& materials = draft_.materials();
    Rng& rng = draft_.rng();
    maker_.Panels(FloorRect({-8, -7.5, 0.125}, {8, 7.5, 0.125}), Material::kFoliage, 2.5);
    maker_.Panels(FloorRect({-11, -1, 0.13}, {11, 1, 0.13}), Material::kPaving);
    draft_.TryPut(MakeKiosk({4, 3.2, 3}, materials, rng), {0, 4, 0.12}, 0);
    for (const double x : {-8.5, -4.5, 4.5, 8.5}) {
      for (const double y : {-7.0, -3.4, 7.0}) {
        draft_.TryPut(MakeTree(rng.Uniform(3.8, 5.8), materials, rng), {x, y, 0.12}, rng.Uniform(0, 1), 0.2);
      }
    }
    const Thing bench = MakeBench(materials, rng);
    for (const double x : {-6.0, -2.0, 2.0, 6.0}) draft_.TryPut(bench, {x, -1.7, 0.12}, std::numbers::pi, 0.1);
  }

  /// Lamps and small trees along the kerbs.
  void AddStreetFurniture() {
    Materials& materials = draft_.materials();
    Rng& rng = draft_.rng();
    const Thing lamp = MakeLampPost(4.6, materials, rng);
    constexpr double kKerb_m = 4.3;  // from the middle of a street, on the pavement
    for (const double street : kStreets_x) {
      for (const double side : {-kKerb_m, kKerb_m}) {
        for (double y = -34; y < 35; y += 7.5) {
          const bool is_tree = rng.Uniform() < 0.4;
          const Thing tree = MakeTree(rng.Uniform(3.0, 3.6), materials, rng);
          draft_.TryPut(is_tree ? tree : lamp, {street + side, y, 0.12}, 0.5 * std::numbers::pi, 0.2);
        }
      }
    }
  }

  /// Cars along both kerbs of the streets, with gaps.
  void AddCars() {
    std::vector<Thing> models;
    for (size_t i = 0; i < kNumCarModels; ++i) models.push_back(MakeCar(i, draft_.options().seed));
    constexpr double kLane_m = 2.65;
    constexpr double kPitch_m = 5.8;
    for (const double side : {-1.0, 1.0}) {
      for (const double x : kStreets_x) {
        for (double y = -33; y < 34; y += kPitch_m)
          AddCar({x + side * kLane_m, y, 0}, side * 0.5 * std::numbers::pi, models);
      }
      for (const double y : kStreets_y) {
        for (double x = -36; x < 37; x += kPitch_m) {
          AddCar({x, y + side * kLane_m, 0}, side > 0 ? std::numbers::pi : 0, models);
        }
      }
    }
  }

  void AddCar(const Eigen::Vector3d& at, double yaw, const std::vector<Thing>& models) {
    Rng& rng = draft_.rng();
    constexpr double kCrossing_m = 6.5;  // nobody parks where streets meet
    for (const double x : kStreets_x) {
      for (const double y : kStreets_y) {
        if (std::abs(at.x() - x) < kCrossing_m && std::abs(at.y() - y) < kCrossing_m) return;
      }
    }
    const size_t model = rng.Below(models.size());
    if (rng.Uniform() < 0.6) {
      draft_.TryPutObject("car", static_cast<uint32_t>(model), models[model], at, yaw + rng.Uniform(-0.03, 0.03), 0.2);
    } else {
      draft_.TryAddSpot({at, yaw, kLargestCar_m}, 0.2);
    }
  }

  /// A lattice of streets, roofs and the park at several heights; what is not free falls out.
  void AddWays() {
    constexpr std::array<double, 7> kX = {-36, -27, -17.5, 0, 17.5, 27, 36};
    constexpr std::array<double, 7> kY = {-34, -26, -16.75, 0, 16.75, 26, 34};
    std::vector<Eigen::Vector3d> nodes;
    std::vector<std::pair<size_t, size_t>> edges;
    const size_t column = kY.size();
    const size_t layer = kX.size() * column;
    for (const double z : kHeights_m) {
      for (size_t i = 0; i < kX.size(); ++i) {
        for (size_t j = 0; j < kY.size(); ++j) {
          const size_t node = nodes.size();
          nodes.emplace_back(kX.at(i), kY.at(j), z);
          const bool above = node >= layer;
          if (j > 0) edges.emplace_back(node - 1, node);
          if (i > 0) edges.emplace_back(node - column, node);
          if (above && j > 0) edges.emplace_back(node - layer - 1, node);
          if (above && i > 0) edges.emplace_back(node - layer - column, node);
          if (above && j + 1 < kY.size()) edges.emplace_back(node - layer + 1, node);
        }
      }
    }
    for (const double x : kStreets_x) {
      for (const double side : {-5.2, 5.2}) {
        draft_.walks_world.push_back({{x + side, -36, 0.12}, {x + side, 36, 0.12}});
      }
    }
    draft_.AddRoutes(nodes, edges);
  }

  Draft& draft_;
  QuadMaker& maker_;
};

}  // namespace

void BuildCity(Draft& draft) { City(draft).Build(); }

}  // namespace mapp::sim
