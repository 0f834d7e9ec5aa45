#include "sim/world/draft.h"

#include <fmt/format.h>

#include <array>
#include <limits>
#include <numbers>

// An underground garage after the paper's evaluation: 45 x 175 m. Across it (y, from -22.5 m) follow a row of bays
// along the wall, a lane, two rows back to back, a lane, two rows, a lane, and a walkway with doors. Along it (x) four
// blocks of bays lie between five cross lanes. Bays in threes stand between equal pillars.

namespace mapp::sim {
namespace {

constexpr double kHalfLength_m = 87.5;
constexpr double kHalfWidth_m = 22.5;
constexpr double kCeiling_m = 2.8;
constexpr double kLaneWidth_m = 6.0;
constexpr double kBayDepth_m = 5.0;
constexpr double kBayWidth_m = 2.7;
constexpr double kPillar_m = 0.5;
constexpr double kEye_m = 1.4;
constexpr int kNumBlocks = 4;
constexpr double kBlockPitch_m = 42.0;
constexpr int kPillarsPerBlock = 5;
constexpr int kBaysPerPillar = 3;
constexpr double kPillarPitch_m = kBaysPerPillar * kBayWidth_m + kPillar_m;
constexpr double kMark_m = 0.003;  ///< paint lies this high above the floor
constexpr double kShareOfBaysTaken = 0.62;
constexpr std::array<double, 3> kLanes_y = {-14.5, 1.5, 17.5};

/// A row of bays: `front_y` borders the lane, the bays lie towards `inwards` (+1 or -1).
struct BayRow {
  double front_y;
  double inwards;
};
constexpr std::array<BayRow, 5> kRows = {{{-17.5, -1}, {-11.5, 1}, {-1.5, -1}, {4.5, 1}, {14.5, -1}}};

/// A ramp along x inside one row: from `from_x` to `to_x` the way climbs by `rise_m`.
struct Ramp {
  double from_x, to_x;
  double min_y, max_y;
  double rise_m;
};
constexpr Ramp kUp = {-39.0, -21.0, 4.9, 9.3, kCeiling_m};
constexpr Ramp kDown = {39.0, 21.0, -6.3, -1.9, -kCeiling_m};

double BlockLeft_x(int block) { return kBlockPitch_m * (block - 2) + 0.5 * kLaneWidth_m; }
double PillarX(int block, int pillar) {
  const double block_m = kBlockPitch_m - kLaneWidth_m;
  const double row_m = (kPillarsPerBlock - 1) * kPillarPitch_m;
  return BlockLeft_x(block) + 0.5 * (block_m - row_m) + pillar * kPillarPitch_m;
}

class Garage {
 public:
  explicit Garage(Draft& draft) : draft_(draft), maker_(draft.scenery()) {}

  void Build() {
    World& world = draft_.world;
    world.bounds_world = Aabb(Eigen::Vector3d(-kHalfLength_m, -kHalfWidth_m, 0),
                              Eigen::Vector3d(kHalfLength_m, kHalfWidth_m, kCeiling_m));
    world.sky_gray = 90;
    world.ambient = 0.6;
    world.routes.clearance_m = 0.85;
    AddShell();
    AddRamp(kUp);
    AddRamp(kDown);
    AddPillars();
    AddCeilingFittings();
    AddWalls();
    AddMarkings();
    AddBays();
    AddWalkway();
    AddWays();
  }

 private:
  /// A level rectangle without the part over [hole.min, hole.max].
  template <typename MakeRect>
  void AddWithHoles(double z, const std::vector<Ramp>& holes, MakeRect make_rect, Material material) {
    // Strips along x: the holes' borders cut y into bands, and bands that cross a hole leave it out.
    std::vector<double> cuts = {-kHalfWidth_m, kHalfWidth_m};
    for (const Ramp& hole : holes) cuts.insert(cuts.end(), {hole.min_y, hole.max_y});
    std::sort(cuts.begin(), cuts.end());
    for (size_t i = 0; i + 1 < cuts.size(); ++i) {
      double from_x = -kHalfLength_m;
      const auto strip = [&](double to_x) {
        if (to_x > from_x) {
          maker_.Panels(make_rect(Eigen::Vector3d(from_x, cuts[i], z), Eigen::Vector3d(to_x, cuts[i + 1], z)),
                        material);
        }
      };
      for (const Ramp& hole : holes) {
        if (cuts[i] < hole.min_y - 1e-9 || cuts[i] >= hole.max_y - 1e-9) continue;
        strip(std::min(hole.from_x, hole.to_x));
        from_x = std::max(hole.from_x, hole.to_x);
      }
      strip(kHalfLength_m);
    }
  }

  void AddShell() {
    AddWithHoles(0, {kDown}, FloorRect, Material::kAsphalt);
    Ramp opening = kUp;
    opening.from_x = kUp.from_x + 5;  // where the ramp is still low the ceiling stays
    AddWithHoles(kCeiling_m, {opening}, CeilingRect, Material::kCeiling);
    const Eigen::Vector3d a(-kHalfLength_m, -kHalfWidth_m, 0), b(kHalfLength_m, -kHalfWidth_m, 0);
    const Eigen::Vector3d c(kHalfLength_m, kHalfWidth_m, 0), d(-kHalfLength_m, kHalfWidth_m, 0);
    maker_.Panels(UprightRect(b, a, kCeiling_m), Material::kConcrete);
    maker_.Panels(UprightRect(c, b, kCeiling_m), Material::kMasonry);
    maker_.Panels(UprightRect(d, c, kCeiling_m), Material::kPlaster);
    maker_.Panels(UprightRect(a, d, kCeiling_m), Material::kMasonry);
  }

  /// The way, the walls beside it, and the shaft above or the pit below.
  void AddRamp(const Ramp& ramp) {
    constexpr double kWall_m = 0.2;
    const double length_m = ramp.to_x - ramp.from_x;  // negative where it runs to -x
    const double min_x = std::min(ramp.from_x, ramp.to_x);
    const double max_x = std::max(ramp.from_x, ramp.to_x);
    // The picture's u along the climb, v across; the corner is the one that makes the front look up.
    const double v = length_m > 0 ? -1 : 1;
    const Eigen::Vector3d start(ramp.from_x, length_m > 0 ? ramp.max_y : ramp.min_y, 0);
    maker_.Panels({start, {length_m, 0, ramp.rise_m}, {0, v * (ramp.max_y - ramp.min_y), 0}}, Material::kAsphalt);
    const bool up = ramp.rise_m > 0;
    const double wall_m = up ? kCeiling_m : 1.0;
    const BoxLook look{Material::kConcrete, Material::kConcrete};
    for (const double y : {ramp.min_y - 0.5 * kWall_m, ramp.max_y + 0.5 * kWall_m}) {
      for (double x = min_x; x < max_x - 0.1; x += 4.5) {
        const Solid piece{{x + 2.25, y, 0.5 * wall_m}, {4.5, kWall_m, wall_m}, 0};
        maker_.Box(piece.center_world, piece.size_m, 0, look);
        draft_.Occupy(piece);
      }
    }
    const Solid end{{ramp.to_x + (length_m > 0 ? 0.5 : -0.5) * kWall_m, 0.5 * (ramp.min_y + ramp.max_y), 0.5 * wall_m},
                    {kWall_m, ramp.max_y - ramp.min_y + 2 * kWall_m, wall_m},
                    0};
    maker_.Box(end.center_world, end.size_m, 0, look);
    const Eigen::Vector3d middle(0.5 * (min_x + max_x), 0.5 * (ramp.min_y + ramp.max_y), 0.5 * kCeiling_m);
    draft_.Occupy({middle, {max_x - min_x + 2 * kWall_m, ramp.max_y - ramp.min_y + 2 * kWall_m, kCeiling_m}, 0});
    // Inside faces of the shaft above (to daylight) or of the pit below.
    const double base = up ? kCeiling_m : -kCeiling_m;
    const double open_x = up ? min_x + 5 : min_x;
    maker_.Panels(UprightRect({open_x, ramp.max_y, base}, {max_x, ramp.max_y, base}, kCeiling_m), Material::kConcrete);
    maker_.Panels(UprightRect({max_x, ramp.min_y, base}, {open_x, ramp.min_y, base}, kCeiling_m), Material::kConcrete);
    const Material far = up ? Material::kPanes : Material::kStripes;
    maker_.Panels(UprightRect({max_x, ramp.max_y, base}, {max_x, ramp.min_y, base}, kCeiling_m),
                  length_m > 0 ? far : Material::kConcrete);
    maker_.Panels(UprightRect({open_x, ramp.min_y, base}, {open_x, ramp.max_y, base}, kCeiling_m),
                  length_m > 0 ? Material::kConcrete : far);
    if (up) {
      maker_.Panels(CeilingRect({open_x, ramp.min_y, 2 * kCeiling_m}, {max_x, ramp.max_y, 2 * kCeiling_m}),
                    Material::kPanes);
    }
  }

  /// Equal pillars; only the plates with their numbers differ.
  void AddPillars() {
    Thing pillar;
    pillar.size_m = {kPillar_m, kPillar_m, kCeiling_m};
    QuadMaker maker(draft_.materials(), draft_.rng(), pillar.quads);
    maker.Box({0, 0, 0.5 * kCeiling_m}, pillar.size_m, 0, {Material::kConcrete, Material::kConcrete});
    pillar.quads.pop_back();  // the top lies in the ceiling
    maker.Box({0, 0, 0.5}, {kPillar_m + 0.03, kPillar_m + 0.03, 1.0}, 0, {Material::kStripes, Material::kStripes});
    for (size_t row = 0; row < kRows.size(); ++row) {
      const double y = kRows[row].front_y + 0.9 * kRows[row].inwards;
      for (int block = 0; block < kNumBlocks; ++block) {
        for (int i = 0; i < kPillarsPerBlock; ++i) {
          const Eigen::Vector3d foot(PillarX(block, i), y, 0);
          if (!draft_.TryPut(pillar, foot, 0)) continue;
          const int number = block * kPillarsPerBlock + i + 1;
          AddPlates(foot, fmt::format("{}{:02}", static_cast<char>('A' + row), number));
        }
      }
    }
  }

  void AddPlates(const Eigen::Vector3d& foot, const std::string& text) {
    constexpr double kPlate_m = 0.42;
    const Picture plate = draft_.materials().Sign(text, kPlate_m, 0.3);
    const double off = 0.5 * kPillar_m + 0.01;
    const double half = 0.5 * kPlate_m;
    const double z = 1.75;
    maker_.Hang(UprightRect(foot + Eigen::Vector3d(-half, -off, z), foot + Eigen::Vector3d(half, -off, z), 0.3), plate);
    maker_.Hang(UprightRect(foot + Eigen::Vector3d(half, off, z), foot + Eigen::Vector3d(-half, off, z), 0.3), plate);
    maker_.Hang(UprightRect(foot + Eigen::Vector3d(off, -half, z), foot + Eigen::Vector3d(off, half, z), 0.3), plate);
    maker_.Hang(UprightRect(foot + Eigen::Vector3d(-off, half, z), foot + Eigen::Vector3d(-off, -half, z), 0.3), plate);
  }

  /// Beams over the pillars, ducts over the rows, pipes and lamps over the lanes.
  void AddCeilingFittings() {
    const BoxLook beam{Material::kConcrete, Material::kConcrete, false, true};
    for (int block = 0; block < kNumBlocks; ++block) {
      for (int i = 0; i < kPillarsPerBlock; ++i) {
        const double x = PillarX(block, i);
        for (double y = -kHalfWidth_m; y < kHalfWidth_m - 0.1; y += 5) {
          maker_.Box({x, y + 2.5, kCeiling_m - 0.15}, {0.4, 5, 0.3}, 0, beam);
        }
      }
    }
    const BoxLook duct{Material::kSheetMetal, Material::kSheetMetal, false, true};
    const BoxLook tube{Material::kTube, Material::kTube, true, true};
    for (const double lane_y : kLanes_y) {
      for (double x = -kHalfLength_m + 2; x < kHalfLength_m - 3; x += 4) {
        maker_.Box({x + 2, lane_y - 2.2, kCeiling_m - 0.38}, {4, 0.14, 0.14}, 0, duct);
        maker_.Box({x + 2, lane_y - 2.45, kCeiling_m - 0.36}, {4, 0.09, 0.09}, 0, duct);
        maker_.Box({x + 2, lane_y + 2.4, kCeiling_m - 0.28}, {4, 0.6, 0.25}, 0, duct);
      }
      for (double x = -84; x < 84.5; x += 6) {
        maker_.Box({x, lane_y + 0.3, kCeiling_m - 0.36}, {1.5, 0.25, 0.1}, 0, tube);
        if (std::lround(x / 6) % 2 == 0)
          draft_.world.lights.push_back({{x, lane_y + 0.3, kCeiling_m - 0.5}, 0.95, 6.0});
      }
      const Material board = Material::kPoster;
      for (double x = -63; x < 64; x += 42) {  // boards that hang across the lane
        maker_.Hang(UprightRect({x, lane_y + 1.2, 2.42}, {x, lane_y - 1.2, 2.42}, 0.35), board);
        maker_.Hang(UprightRect({x - 0.02, lane_y - 1.2, 2.42}, {x - 0.02, lane_y + 1.2, 2.42}, 0.35), board);
      }
    }
  }

  /// Posters, doors and pipes on the outer walls.
  void AddWalls() {
    constexpr double kOff_m = 0.015;
    Rng& rng = draft_.rng();
    for (double x = -kHalfLength_m + 1.5; x < kHalfLength_m - 2.5; x += rng.Uniform(3.5, 7.0)) {
      const double y = -kHalfWidth_m + kOff_m;
      maker_.Hang(UprightRect({x + 0.9, y, 1.1}, {x, y, 1.1}, 1.2), Material::kPoster);
    }
    const BoxLook pipe{Material::kPlates, Material::kPlates, false, true};
    for (double x = -kHalfLength_m; x < kHalfLength_m - 1; x += 5) {
      maker_.Box({x + 2.5, -kHalfWidth_m + 0.12, 2.3}, {5, 0.12, 0.12}, 0, pipe);
      maker_.Box({x + 2.5, -kHalfWidth_m + 0.12, 0.3}, {5, 0.06, 0.06}, 0, pipe);
    }
    for (const double side : {-1.0, 1.0}) {
      const double x = side * (kHalfLength_m - kOff_m);
      for (double y = -kHalfWidth_m + 2; y < kHalfWidth_m - 3; y += rng.Uniform(3.0, 5.0)) {
        const bool door = rng.Uniform() < 0.35;
        const double low = door ? 0 : 1.1;
        const double wide = door ? 1.1 : 0.9;
        const double high = door ? 2.1 : 1.2;
        const Eigen::Vector3d p(x, y - side * -0.5 * wide, low), q(x, y + side * -0.5 * wide, low);
        maker_.Hang(UprightRect(p, q, high), door ? Material::kDoor : Material::kPoster);
      }
    }
  }

  void AddMarkings() {
    const auto mark = [&](double min_x, double max_x, double min_y, double max_y) {
      maker_.Hang(FloorRect({min_x, min_y, kMark_m}, {max_x, max_y, kMark_m}), Material::kRoadLine);
    };
    for (const double y : kLanes_y) {
      for (int block = 0; block < kNumBlocks; ++block) {
        for (const double at : {9.0, 27.0}) AddArrow(BlockLeft_x(block) + at, y + (at < 18 ? 1.4 : -1.4), at < 18);
        for (double x = BlockLeft_x(block) + 1; x < BlockLeft_x(block) + 34; x += 6) mark(x, x + 3, y - 0.06, y + 0.06);
      }
      for (double x = -84; x < 85; x += 42) {  // stop lines before the cross lanes
        mark(x - 3.2, x - 2.9, y + 0.3, y + 2.8);
        mark(x + 2.9, x + 3.2, y - 2.8, y - 0.3);
      }
    }
  }

  void AddArrow(double x, double y, bool to_right) {
    const Rect right = FloorRect({x - 1.5, y - 0.55, kMark_m}, {x + 1.5, y + 0.55, kMark_m});
    maker_.Hang(to_right ? right : Rect{right.corner + right.edge_u + right.edge_v, -right.edge_u, -right.edge_v},
                Material::kArrow);
  }

  /// The bays with their lines and numbers, and the cars in most of them.
  void AddBays() {
    std::vector<Thing> models;
    for (size_t i = 0; i < kNumCarModels; ++i) models.push_back(MakeCar(i, draft_.options().seed));
    int number = 0;
    for (const BayRow& row : kRows) {
      for (int block = 0; block < kNumBlocks; ++block) {
        for (int i = 0; i + 1 < kPillarsPerBlock; ++i) {
          for (int bay = 0; bay < kBaysPerPillar; ++bay) {
            const double left_x = PillarX(block, i) + 0.5 * kPillar_m + bay * kBayWidth_m;
            AddBay(row, left_x, ++number, models);
          }
        }
      }
    }
  }

  void AddBay(const BayRow& row, double left_x, int number, const std::vector<Thing>& models) {
    Rng& rng = draft_.rng();
    const Eigen::Vector3d middle(left_x + 0.5 * kBayWidth_m, row.front_y + 0.5 * kBayDepth_m * row.inwards, 0);
    if (!draft_.IsFree({middle + Eigen::Vector3d(0, 0, 0.5), {kBayWidth_m - 0.4, kBayDepth_m - 0.2, 1.0}, 0}, 0))
      return;
    const double back_y = row.front_y + kBayDepth_m * row.inwards;
    const double min_y = std::min(row.front_y, back_y), max_y = std::max(row.front_y, back_y);
    const Rect line = FloorRect({left_x - 0.06, min_y, kMark_m}, {left_x + 0.06, max_y, kMark_m});
    maker_.Hang({line.corner + line.edge_u, line.edge_v, -line.edge_u}, Material::kRoadLine);
    const double sign = row.inwards;  // numbers are read from the lane
    const Eigen::Vector3d at(middle.x(), row.front_y + 0.35 * sign, kMark_m);
    maker_.Hang({at + Eigen::Vector3d(-0.4 * sign, 0.15 * sign, 0), {0.8 * sign, 0, 0}, {0, -0.3 * sign, 0}},
                draft_.materials().Sign(fmt::format("{:03}", number), 0.8, 0.3));
    const double yaw = (rng.Uniform() < 0.7 ? 0.5 : -0.5) * std::numbers::pi * row.inwards + rng.Uniform(-0.02, 0.02);
    const Eigen::Vector3d stand = middle + Eigen::Vector3d(rng.Uniform(-0.15, 0.15), rng.Uniform(-0.1, 0.1), 0);
    const size_t model = rng.Below(models.size());
    const bool taken = rng.Uniform() < kShareOfBaysTaken;
    if (taken && draft_.TryPutObject("car", static_cast<uint32_t>(model), models[model], stand, yaw, 0)) return;
    draft_.TryAddSpot({middle, yaw, kLargestCar_m}, 0);
  }

  /// Doors, lockers, machines for tickets and cartons between the last lane and the wall.
  void AddWalkway() {
    Rng& rng = draft_.rng();
    const double wall_y = kHalfWidth_m - 0.015;
    for (double x = -kHalfLength_m + 3; x < kHalfLength_m - 4; x += rng.Uniform(3.2, 5.0)) {
      const uint64_t what = rng.Below(5);
      if (what == 0) {
        maker_.Hang(UprightRect({x, wall_y, 0}, {x + 1.1, wall_y, 0}, 2.1), Material::kDoor);
      } else if (what == 1) {
        maker_.Hang(UprightRect({x, wall_y, 1.1}, {x + 0.9, wall_y, 1.1}, 1.2), Material::kPoster);
      } else {
        const Eigen::Vector3d size_m(rng.Uniform(0.6, 1.6), rng.Uniform(0.4, 0.8), rng.Uniform(0.8, 2.0));
        const Material side = what == 2 ? Material::kMachine : what == 3 ? Material::kPlates : Material::kCarton;
        const Thing thing = MakeBox(size_m, {side, side, true, false}, draft_.materials(), rng);
        draft_.TryPut(thing, {x + 0.8, kHalfWidth_m - 0.03 - 0.5 * size_m.y(), 0}, 0);
      }
    }
  }

  void AddWays() {
    std::vector<Eigen::Vector3d> nodes;
    std::vector<std::pair<size_t, size_t>> edges;
    constexpr size_t kStops = 13;  // along a lane: every cross lane, and two places between each pair
    for (const double y : kLanes_y) {
      for (size_t i = 0; i < kStops; ++i) {
        nodes.emplace_back(-84 + 14.0 * static_cast<double>(i), y, kEye_m);
        if (i > 0) edges.emplace_back(nodes.size() - 2, nodes.size() - 1);
        if (i % 3 == 0 && nodes.size() > kStops) edges.emplace_back(nodes.size() - 1 - kStops, nodes.size() - 1);
      }
      draft_.walks_world.push_back({{-82, y - 1.6, 0}, {-4, y - 1.9, 0}, {82, y - 1.6, 0}});
      draft_.walks_world.push_back({{-80, y + 1.8, 0}, {10, y + 2.0, 0}, {80, y + 1.7, 0}});
    }
    draft_.AddRoutes(nodes, edges);
  }

  Draft& draft_;
  QuadMaker& maker_;
};

}  // namespace

void BuildGarage(Draft& draft) { Garage(draft).Build(); }

}  // namespace mapp::sim
