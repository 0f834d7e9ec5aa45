#include "sim/world/draft.h"

#include <fmt/format.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <numbers>

// A machine hall of the size of EuRoC's: machines and racks in cells between straight aisles, crates that come and go,
// pipes, windows and posters on the walls, beams and a crane under the roof. Given flights make it as large as they
// need, and nothing stands in their way.

namespace mapp::sim {
namespace {

constexpr double kQuarterTurn = std::numbers::pi / 2;
constexpr double kAisle_m = 1.9;
constexpr std::array<double, 3> kHeights_m = {1.2, 2.2, 3.3};  ///< that devices fly at, above the floor

class Hall {
 public:
  explicit Hall(Draft& draft) : draft_(draft), maker_(draft.scenery()) {
    const std::vector<Eigen::Vector3d>& keep_free = draft.options().keep_free_world;
    box_ = Aabb(Eigen::Vector3d(-10, -8, 0), Eigen::Vector3d(10, 8, 7));
    if (!keep_free.empty()) {
      box_.setEmpty();
      for (const Eigen::Vector3d& p_world : keep_free) box_.extend(p_world);
      const double below_m = draft.options().clearance_m + 0.3;
      box_ = Aabb(box_.min() - Eigen::Vector3d(3, 3, below_m), box_.max() + Eigen::Vector3d(3, 3, 3));
      // A short flight still gets a hall.
      const Eigen::Vector3d missing = (Eigen::Vector3d(12, 12, 6) - box_.sizes()).cwiseMax(0.0);
      box_.min().head<2>() -= 0.5 * missing.head<2>();
      box_.max().head<2>() += 0.5 * missing.head<2>();
      box_.max().z() += missing.z();
    }
  }

  void Build() {
    World& world = draft_.world;
    world.bounds_world = box_;
    world.ambient = 0.5;
    world.sky_gray = 60;
    world.routes.clearance_m = 0.6;
    PlanAisles();
    AddShell();
    AddRoofBeams();
    for (const double side : {-1.0, 1.0}) {
      FurnishWall(Wall{true, side});
      FurnishWall(Wall{false, side});
    }
    AddMachines();
    AddCrates();
    AddMarkings();
    AddLights();
    AddWays();
  }

 private:
  /// A wall at the end of x (or y), at the low (-1) or high (+1) side.
  struct Wall {
    bool across_x;
    double side;
  };

  double floor() const { return box_.min().z(); }
  double height() const { return box_.sizes().z(); }
  Eigen::Vector3d OnFloor(double x, double y) const { return {x, y, floor()}; }

  void PlanAisles() {
    const auto lines = [](double min, double max) {
      const auto count = std::max(static_cast<int>(std::lround((max - min) / 6.0)), 2);
      std::vector<double> at;
      for (int i = 0; i < count; ++i) at.push_back(min + 2.0 + (max - min - 4.0) * i / (count - 1));
      return at;
    };
    aisles_x_ = lines(box_.min().x(), box_.max().x());
    aisles_y_ = lines(box_.min().y(), box_.max().y());
  }

  void AddShell() {
    const Eigen::Vector3d min = box_.min();
    const Eigen::Vector3d max = box_.max();
    maker_.Panels(FloorRect(min, {max.x(), max.y(), min.z()}), Material::kAsphalt);
    maker_.Panels(CeilingRect({min.x(), min.y(), max.z()}, max), Material::kSheetMetal);
    const std::array<Eigen::Vector3d, 5> corners = {OnFloor(min.x(), min.y()), OnFloor(min.x(), max.y()),
                                                    OnFloor(max.x(), max.y()), OnFloor(max.x(), min.y()),
                                                    OnFloor(min.x(), min.y())};
    constexpr std::array kMaterials = {Material::kMasonry, Material::kPlates, Material::kConcrete, Material::kPlaster};
    for (size_t i = 0; i < kMaterials.size(); ++i) {
      maker_.Panels(UprightRect(corners[i], corners[i + 1], height()), kMaterials[i], 3.5);
    }
  }

  void AddRoofBeams() {
    const BoxLook beam{Material::kPlates, Material::kPlates, false, true};
    const double top = box_.max().z();
    const auto put = [&](const Eigen::Vector3d& center, const Eigen::Vector3d& size_m, const BoxLook& look) {
      const Solid solid{center, size_m, 0};
      if (!draft_.IsFree(solid, 0)) return;
      draft_.Occupy(solid);
      maker_.Box(center, size_m, 0, look);
    };
    const double middle_y = box_.center().y();
    for (double x = box_.min().x() + 2; x < box_.max().x() - 1; x += 4) {
      put({x, middle_y, top - 0.25}, {0.3, box_.sizes().y(), 0.5}, beam);
    }
    const double crane_x = box_.min().x() + 0.6 * box_.sizes().x();
    put({crane_x, middle_y, top - 0.85}, {0.7, box_.sizes().y() - 0.4, 0.6},
        {Material::kStripes, Material::kPlates, false, true});
    put({crane_x, middle_y + 2, top - 1.45}, {0.9, 0.9, 0.55}, {Material::kMachine, Material::kMachine, true, true});
    for (double y = box_.min().y() + 3; y < box_.max().y() - 1; y += 5) {
      put({box_.center().x(), y, top - 0.62}, {box_.sizes().x() - 0.4, 0.18, 0.18}, beam);
    }
  }

  /// A point on a wall, `along` it from its middle, to the right as seen from inside, `off_m` into the hall.
  Eigen::Vector3d OnWall(const Wall& wall, double along, double off_m, double above_floor_m) const {
    const Eigen::Vector3d middle = box_.center();
    const double z = floor() + above_floor_m;
    if (wall.across_x) {
      const double x = wall.side > 0 ? box_.max().x() - off_m : box_.min().x() + off_m;
      return {x, middle.y() - wall.side * along, z};
    }
    const double y = wall.side > 0 ? box_.max().y() - off_m : box_.min().y() + off_m;
    return {middle.x() + wall.side * along, y, z};
  }

  void HangOn(const Wall& wall, double along, double low_m, double width_m, double height_m, Material material) {
    constexpr double kOff_m = 0.012;
    maker_.Hang(UprightRect(OnWall(wall, along - 0.5 * width_m, kOff_m, low_m),
                            OnWall(wall, along + 0.5 * width_m, kOff_m, low_m), height_m),
                material);
  }

  /// Windows above, pipes below them, posters, doors and racks on the floor.
  void FurnishWall(const Wall& wall) {
    Rng& rng = draft_.rng();
    const double length_m = wall.across_x ? box_.sizes().y() : box_.sizes().x();
    const double window_m = 0.58 * height();
    for (double along = -0.5 * length_m + 2.5; along < 0.5 * length_m - 2; along += 4.5) {
      HangOn(wall, along, window_m, 3.2, 0.3 * height(), Material::kPanes);
    }
    for (double along = -0.5 * length_m + 0.8; along < 0.5 * length_m - 0.8; along += rng.Uniform(1.3, 2.4)) {
      if (rng.Uniform() < 0.2) {
        HangOn(wall, along, 0, 1.1, 2.1, Material::kDoor);
      } else {
        HangOn(wall, along, rng.Uniform(1.0, 2.2), 0.8, 1.05, Material::kPoster);
      }
    }
    const BoxLook pipe{Material::kSheetMetal, Material::kSheetMetal, false, true};
    for (const double z : {window_m - 0.25, window_m - 0.55}) {
      const double thick_m = z < window_m - 0.4 ? 0.2 : 0.12;
      Eigen::Vector3d size_m = Eigen::Vector3d::Constant(thick_m);
      size_m[wall.across_x ? 1 : 0] = length_m - 0.6;
      const Eigen::Vector3d center = OnWall(wall, 0, 0.2, z);
      if (draft_.IsFree({center, size_m, 0}, -0.3)) maker_.Box(center, size_m, 0, pipe);
    }
    const double yaw = wall.across_x ? -wall.side * std::numbers::pi / 2 : (wall.side > 0 ? 0.0 : std::numbers::pi);
    for (double along = -0.5 * length_m + 1.4; along < 0.5 * length_m - 1.4; along += rng.Uniform(2.6, 4.0)) {
      const Thing rack = rng.Uniform() < 0.6
                             ? MakeRack({2.0, 0.6, rng.Uniform(1.7, 2.6)}, draft_.materials(), rng)
                             : MakeBox({rng.Uniform(0.7, 1.3), 0.5, rng.Uniform(1.2, 2.0)},
                                       {Material::kMachine, Material::kPlates, true, false}, draft_.materials(), rng);
      draft_.TryPut(rack, OnWall(wall, along, 0.36, 0), yaw);
    }
  }

  /// Keeps things off the aisles: is a solid's outline clear of them?
  bool ClearOfAisles(const Eigen::Vector3d& center, double half_x, double half_y) const {
    const auto clear = [](const std::vector<double>& aisles, double at, double half) {
      return std::ranges::all_of(aisles, [&](double aisle) { return std::abs(at - aisle) >= half + 0.5 * kAisle_m; });
    };
    return clear(aisles_x_, center.x(), half_x) && clear(aisles_y_, center.y(), half_y);
  }

  void AddMachines() {
    Rng& rng = draft_.rng();
    constexpr int kTries = 260;
    for (int i = 0; i < kTries; ++i) {
      const double tallest_m = std::min(3.6, height() - 2.0);
      const double shrink = 1.0 - 0.6 * i / kTries;  // small ones fill what large ones left
      const Eigen::Vector3d size_m(shrink * rng.Uniform(2.0, 3.6), shrink * rng.Uniform(1.2, 2.4),
                                   std::max(shrink * rng.Uniform(1.6, tallest_m), 1.0));
      const bool turned = rng.Uniform() < 0.5;
      const double half_x = 0.5 * (turned ? size_m.y() : size_m.x());
      const double half_y = 0.5 * (turned ? size_m.x() : size_m.y());
      const Eigen::Vector3d at = OnFloor(rng.Uniform(box_.min().x() + half_x, box_.max().x() - half_x),
                                         rng.Uniform(box_.min().y() + half_y, box_.max().y() - half_y));
      if (!ClearOfAisles(at, half_x, half_y)) continue;
      // The look costs more than the question whether there is room.
      if (!draft_.IsFree({at + Eigen::Vector3d(0, 0, 0.5 * size_m.z()), size_m, turned ? kQuarterTurn : 0.0}, 0.35))
        continue;
      const bool rack = rng.Uniform() < 0.2;
      const Thing thing =
          rack ? MakeRack(size_m, draft_.materials(), rng) : MakeMachine(size_m, draft_.materials(), rng);
      draft_.TryPut(thing, at, turned ? kQuarterTurn : 0.0, 0.35);
    }
  }

  /// Boxes and cartons of few models, and places where more may come to stand.
  void AddCrates() {
    constexpr size_t kNumModels = 6;
    constexpr int kTries = 1500;
    constexpr int kMaxCrates = 40;
    const Eigen::Vector3d largest_m(1.2, 1.0, 1.6);
    Rng& rng = draft_.rng();
    std::vector<Thing> models;
    for (size_t i = 0; i < kNumModels; ++i) {
      const Eigen::Vector3d size_m(rng.Uniform(0.6, 1.1), rng.Uniform(0.6, 0.95), rng.Uniform(0.5, 1.2));
      models.push_back(
          i % 2 == 0 ? MakeCartons(draft_.materials(), rng)
                     : MakeBox(size_m, {Material::kPlanks, Material::kPlanks, true, false}, draft_.materials(), rng));
    }
    int num_crates = 0;
    for (int i = 0; i < kTries && num_crates < kMaxCrates; ++i) {
      const Eigen::Vector3d at = OnFloor(rng.Uniform(box_.min().x() + 0.7, box_.max().x() - 0.7),
                                         rng.Uniform(box_.min().y() + 0.7, box_.max().y() - 0.7));
      const double yaw = rng.Uniform(0, 2 * std::numbers::pi);
      if (!ClearOfAisles(at, 0.45, 0.45)) continue;
      if (i % 4 == 3) {
        draft_.TryAddSpot({at, yaw, largest_m}, 0.1);
        continue;
      }
      const size_t model = rng.Below(models.size());
      if (draft_.TryPutObject("box", static_cast<uint32_t>(model), models[model], at, yaw, 0.1)) ++num_crates;
    }
  }

  void AddMarkings() {
    constexpr double kMark_m = 0.003;
    const double z = floor() + kMark_m;
    for (const double x : aisles_x_) {
      for (const double side : {-0.5, 0.5}) {
        const double at = x + side * kAisle_m;
        const Rect line = FloorRect({at - 0.06, box_.min().y() + 1, z}, {at + 0.06, box_.max().y() - 1, z});
        maker_.Hang({line.corner + line.edge_u, line.edge_v, -line.edge_u}, Material::kRoadLine);
      }
    }
    for (const double y : aisles_y_) {
      maker_.Cover(FloorRect({box_.min().x() + 1, y - 0.5 * kAisle_m - 0.2, z + 0.001},
                             {box_.max().x() - 1, y - 0.5 * kAisle_m, z + 0.001}),
                   Material::kStripes);
    }
  }

  void AddLights() {
    for (double x = box_.min().x() + 3; x < box_.max().x(); x += 6.5) {
      for (double y = box_.min().y() + 3; y < box_.max().y(); y += 6.5) {
        draft_.world.lights.push_back({{x, y, box_.max().z() - 0.9}, 0.38, 5.0});
      }
    }
  }

  void AddWays() {
    std::vector<Eigen::Vector3d> nodes;
    std::vector<std::pair<size_t, size_t>> edges;
    const size_t layer = aisles_x_.size() * aisles_y_.size();
    for (const double above_floor_m : kHeights_m) {
      for (size_t i = 0; i < aisles_x_.size(); ++i) {
        for (size_t j = 0; j < aisles_y_.size(); ++j) {
          const size_t node = nodes.size();
          nodes.emplace_back(aisles_x_[i], aisles_y_[j], floor() + above_floor_m);
          if (j > 0) edges.emplace_back(node - 1, node);
          if (i > 0) edges.emplace_back(node - aisles_y_.size(), node);
          if (node < layer) continue;
          // Slanting up and down along both kinds of aisles.
          if (j > 0) edges.emplace_back(node - 1 - layer, node);
          if (i > 0) edges.emplace_back(node - aisles_y_.size() - layer, node);
        }
      }
    }
    for (const double x : aisles_x_) {
      draft_.walks_world.push_back({OnFloor(x + 0.5, aisles_y_.front()), OnFloor(x + 0.5, aisles_y_.back())});
    }
    draft_.AddRoutes(nodes, edges);
  }

  Draft& draft_;
  QuadMaker& maker_;
  Aabb box_;
  std::vector<double> aisles_x_;
  std::vector<double> aisles_y_;
};

}  // namespace

void BuildHall(Draft& draft) { Hall(draft).Build(); }

}  // namespace mapp::sim
