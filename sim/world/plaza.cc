#include "sim/world/streets.h"

#include <array>
#include <cmath>
#include <limits>
#include <numbers>

// An open square of 60 x 45 m after the paper's evaluation: houses around it, streets that leave at its corners, and
// few things on it: a fountain, kiosks and benches, planters, lamp posts. Most of what is seen is far away.

namespace mapp::sim {
namespace {

constexpr double kHalfLength_m = 30;
constexpr double kHalfWidth_m = 22.5;
constexpr double kHouse_m = 9;  ///< depth of the houses around
constexpr double kAlley_m = 4;  ///< between houses here and there
constexpr double kEye_m = 1.5;
constexpr std::array<double, 6> kWays_x = {-24, -14.5, -5.5, 5.5, 14.5, 24};
constexpr std::array<double, 4> kWays_y = {-17, -6, 6, 17};

class Plaza {
 public:
  explicit Plaza(Draft& draft) : draft_(draft), maker_(draft.scenery()) {}

  void Build() {
    World& world = draft_.world;
    world.bounds_world =
        Aabb(Eigen::Vector3d(-kHalfLength_m, -kHalfWidth_m, 0), Eigen::Vector3d(kHalfLength_m, kHalfWidth_m, 12));
    world.sky_gray = 225;
    world.ambient = 0.62;
    world.lights.push_back({{900, -1400, 1600}, 0.5, std::numeric_limits<double>::infinity()});
    world.routes.clearance_m = 0.8;
    AddGround();
    AddHouses();
    AddFountain();
    AddFurniture();
    AddStands();
    AddWays();
  }

 private:
  void AddGround() {
    const double x = kHalfLength_m + kHouse_m + 6;
    const double y = kHalfWidth_m + kHouse_m + 6;
    maker_.Panels(FloorRect({-x, -y, 0}, {x, y, 0}), Material::kPaving);
    // Bands of darker stone, and a few covers of shafts.
    for (const double at : {-20.0, -10.0, 10.0, 20.0}) {
      maker_.Panels(FloorRect({at - 0.4, -kHalfWidth_m, 0.003}, {at + 0.4, kHalfWidth_m, 0.003}), Material::kAsphalt);
    }
    Rng& rng = draft_.rng();
    for (int i = 0; i < 14; ++i) {
      const double cx = rng.Uniform(-28, 28), cy = rng.Uniform(-20, 20);
      maker_.Cover(FloorRect({cx - 0.35, cy - 0.35, 0.006}, {cx + 0.35, cy + 0.35, 0.006}), Material::kPlates);
    }
  }

  /// Houses along all four sides, each of its own height and facade, with alleys between some.
  void AddHouses() {
    Rng& rng = draft_.rng();
    const auto row = [&](double from, double to, auto add) {
      while (to - from > 6) {
        double length_m = rng.Uniform(10, 16);
        if (to - from - length_m < 9) length_m = to - from;
        add(from, from + length_m);
        from += length_m + (rng.Uniform() < 0.4 ? kAlley_m : 0);
      }
    };
    const double x = kHalfLength_m;
    const double y = kHalfWidth_m;
    const auto house = [&](const Eigen::Vector2d& min, const Eigen::Vector2d& max) {
      AddBuilding({min, max, 3 + static_cast<int>(rng.Below(4)), AnyFacade(rng), rng.Uniform() < 0.6}, draft_);
    };
    row(-x + 4, x - 4, [&](double from, double to) { house({from, y}, {to, y + kHouse_m}); });
    row(-x + 4, x - 4, [&](double from, double to) { house({from, -y - kHouse_m}, {to, -y}); });
    row(-y + 4, y - 4, [&](double from, double to) { house({x, from}, {x + kHouse_m, to}); });
    row(-y + 4, y - 4, [&](double from, double to) { house({-x - kHouse_m, from}, {-x, to}); });
    // What closes the views through corners and alleys.
    const double far_x = x + kHouse_m + 5, far_y = y + kHouse_m + 5;
    const Eigen::Vector3d a(-far_x, -far_y, 0), b(far_x, -far_y, 0), c(far_x, far_y, 0), d(-far_x, far_y, 0);
    constexpr double kFar_m = 15;
    maker_.Facade(UprightRect(b, a, kFar_m), Material::kFacadeA);
    maker_.Facade(UprightRect(c, b, kFar_m), Material::kFacadeB);
    maker_.Facade(UprightRect(d, c, kFar_m), Material::kFacadeC);
    maker_.Facade(UprightRect(a, d, kFar_m), Material::kFacadeD);
  }

  void Put(const Thing& thing, double x, double y, double yaw) { draft_.TryPut(thing, {x, y, 0}, yaw, 0.4); }

  void AddFountain() {
    Thing fountain;
    fountain.size_m = {6, 6, 3.4};
    QuadMaker maker(draft_.materials(), draft_.rng(), fountain.quads);
    maker.Box({0, 0, 0.3}, {6, 6, 0.6}, 0, {Material::kConcrete, Material::kPlaster});
    maker.Box({0, 0, 0.9}, {3.2, 3.2, 0.6}, 0, {Material::kPlaster, Material::kConcrete});
    maker.Box({0, 0, 1.8}, {1.2, 1.2, 1.2}, 0, {Material::kMasonry, Material::kConcrete});
    maker.Box({0, 0, 2.9}, {0.7, 0.7, 1.0}, 0.5, {Material::kPlates, Material::kPlates});
    draft_.TryPut(fountain, {0, 0, 0}, 0);
  }

  /// What always stands there: lamp posts, benches around the fountain, trees at the ends.
  void AddFurniture() {
    Materials& materials = draft_.materials();
    Rng& rng = draft_.rng();
    const Thing lamp = MakeLampPost(4.2, materials, rng);
    for (const double x : {-19.0, 0.0, 19.0}) {
      for (const double y : {-11.5, 11.5}) Put(lamp, x, y, 0);
    }
    const Thing bench = MakeBench(materials, rng);
    for (const double x : {-9.5, 9.5}) {
      for (const double y : {-2.5, 2.5}) Put(bench, x, y, x > 0 ? -0.5 * std::numbers::pi : 0.5 * std::numbers::pi);
    }
    for (const double x : {-27.8, 27.8}) {
      for (const double y : {-11.0, 0.0, 11.0})
        Put(MakeTree(rng.Uniform(4.5, 6), materials, rng), x, y, rng.Uniform(0, 1));
    }
  }

  /// Kiosks, planters and stacks of cartons, which come and go.
  void AddStands() {
    Materials& materials = draft_.materials();
    Rng& rng = draft_.rng();
    const std::array<Thing, 6> models = {
        MakeKiosk({3.0, 2.4, 2.8}, materials, rng),
        MakeKiosk({2.6, 2.6, 2.6}, materials, rng),
        MakePlanter(materials, rng),
        MakePlanter(materials, rng),
        MakeCartons(materials, rng),
        MakeBox({1.6, 0.9, 1.3}, {Material::kPoster, Material::kPlates, true, false}, materials, rng)};
    // Places lie in the fields between the ways.
    std::vector<Eigen::Vector2d> places;
    for (size_t i = 0; i + 1 < kWays_x.size(); ++i) {
      for (size_t j = 0; j + 1 < kWays_y.size(); ++j) {
        const double x = 0.5 * (kWays_x[i] + kWays_x[i + 1]), y = 0.5 * (kWays_y[j] + kWays_y[j + 1]);
        for (const double side : {-1.7, 1.7}) places.emplace_back(x + side, y + rng.Uniform(-1.5, 1.5));
      }
    }
    for (size_t i = 0; i < places.size(); ++i) {
      const Eigen::Vector3d at(places[i].x(), places[i].y(), 0);
      const double yaw = 0.5 * std::numbers::pi * static_cast<double>(rng.Below(4)) + rng.Uniform(-0.15, 0.15);
      const size_t model = rng.Below(models.size());
      if (i % 3 == 2) {
        draft_.TryAddSpot({at, yaw, Eigen::Vector3d(3.0, 2.6, 2.8)}, 0.3);
      } else {
        draft_.TryPutObject("box", static_cast<uint32_t>(model), models.at(model), at, yaw, 0.3);
      }
    }
  }

  void AddWays() {
    std::vector<Eigen::Vector3d> nodes;
    std::vector<std::pair<size_t, size_t>> edges;
    const size_t rows = kWays_y.size();
    for (size_t i = 0; i < kWays_x.size(); ++i) {
      for (size_t j = 0; j < rows; ++j) {
        const size_t node = nodes.size();
        nodes.emplace_back(kWays_x[i], kWays_y[j], kEye_m);
        if (j > 0) edges.emplace_back(node - 1, node);
        if (i == 0) continue;
        edges.emplace_back(node - rows, node);
        if (j > 0) edges.emplace_back(node - rows - 1, node);  // slanting across the fields where they are empty
        if (j + 1 < rows) edges.emplace_back(node - rows + 1, node);
      }
    }
    for (const double x : {-15.0, 15.0}) draft_.walks_world.push_back({{x, -20, 0}, {x + 1, 0, 0}, {x, 20, 0}});
    for (const double y : {-18.0, -6.5, 6.5, 18.0})
      draft_.walks_world.push_back({{-26, y, 0}, {0, y + 0.5, 0}, {26, y, 0}});
    draft_.AddRoutes(nodes, edges);
  }

  Draft& draft_;
  QuadMaker& maker_;
};

}  // namespace

void BuildPlaza(Draft& draft) { Plaza(draft).Build(); }

}  // namespace mapp::sim
