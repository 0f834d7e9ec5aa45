#include "sim/room.h"

#include "mapp/base/rng.h"
#include "sim/paint.h"

#include <Eigen/Geometry>
#include <fmt/format.h>

#include <array>
#include <cmath>
#include <exception>

namespace mapp::sim {
namespace {

constexpr double kWallTexels_per_m = 250;
constexpr double kThingTexels_per_m = 400;
constexpr double kPosterTexels_per_m = 500;
/// Walls reach this far past each other, so that no ray slips through the seam.
constexpr double kOverlap_m = 0.01;

using PaintFunction = GrayImage (*)(const Canvas&, Rng&);

/// A wall seen from inside.
struct Wall {
  Eigen::Vector3d top_left_world;
  Eigen::Vector3d right_world;   ///< unit
  Eigen::Vector3d inward_world;  ///< unit
  double length_m = 0;

  /// `along_m` from the left end, `height_m` above the floor, `off_m` into the room.
  Eigen::Vector3d At(double along_m, double height_m, double off_m) const {
    Eigen::Vector3d p_world = top_left_world + along_m * right_world + off_m * inward_world;
    p_world.z() = height_m;
    return p_world;
  }
  double Yaw() const { return std::atan2(right_world.y(), right_world.x()); }
};

class RoomBuilder {
 public:
  explicit RoomBuilder(uint64_t seed)
      : rng_(seed),
        size_m_(6.0 + rng_.Uniform(-0.2, 0.2), 5.0 + rng_.Uniform(-0.2, 0.2), 3.0 + rng_.Uniform(-0.1, 0.1)) {
    lamp_.p_world = {rng_.Uniform(-0.5, 0.5), rng_.Uniform(-0.5, 0.5), size_m_.z() - 0.3};
  }

  std::shared_ptr<const Scene> Build() {
    AddShell();
    AddTable();
    for (size_t i = 0; i < 4; ++i) FurnishWall(WallAt(i), i);
    AddQuad({-1.3, 0.9, 0.005}, {2.6, 0, 0}, {0, -1.8, 0}, With(PaintRug, kWallTexels_per_m), lamp_, *scene_);
    return scene_;
  }

 private:
  /// Wall 0 is the one at negative y; the others follow to its left as seen from inside.
  Wall WallAt(size_t i) const {
    static const std::array<Eigen::Vector3d, 4> kInward = {Eigen::Vector3d{0, 1, 0}, Eigen::Vector3d{-1, 0, 0},
                                                           Eigen::Vector3d{0, -1, 0}, Eigen::Vector3d{1, 0, 0}};
    Wall wall;
    wall.inward_world = kInward.at(i);
    wall.right_world = wall.inward_world.cross(-Eigen::Vector3d::UnitZ()).normalized();
    wall.length_m = std::abs(wall.right_world.dot(size_m_));
    wall.top_left_world = -0.5 * std::abs(wall.inward_world.dot(size_m_)) * wall.inward_world -
                          0.5 * wall.length_m * wall.right_world + Eigen::Vector3d(0, 0, size_m_.z());
    return wall;
  }

  Painter With(PaintFunction paint, double texels_per_m) {
    return [this, paint, texels_per_m](double width_m, double height_m) {
      return paint({width_m, height_m, texels_per_m}, rng_);
    };
  }

  void AddShell() {
    static constexpr std::array<PaintFunction, 4> kPaints = {PaintBricks, PaintConcrete, PaintPlates, PaintConcrete};
    const size_t first = rng_.Below(kPaints.size());
    for (size_t i = 0; i < kPaints.size(); ++i) {
      const Wall wall = WallAt(i);
      AddQuad(wall.At(-kOverlap_m, size_m_.z() + kOverlap_m, 0), (wall.length_m + 2 * kOverlap_m) * wall.right_world,
              {0, 0, -size_m_.z() - 2 * kOverlap_m}, With(kPaints[(first + i) % kPaints.size()], kWallTexels_per_m),
              lamp_, *scene_);
    }
    const Eigen::Vector3d half_m = 0.5 * size_m_ + Eigen::Vector3d::Constant(kOverlap_m);
    AddQuad({-half_m.x(), half_m.y(), 0}, {2 * half_m.x(), 0, 0}, {0, -2 * half_m.y(), 0},
            With(PaintPlanks, kWallTexels_per_m), lamp_, *scene_);
    AddQuad({-half_m.x(), -half_m.y(), size_m_.z()}, {2 * half_m.x(), 0, 0}, {0, 2 * half_m.y(), 0},
            With(PaintPlates, kWallTexels_per_m), lamp_, *scene_);
  }

  void AddThing(const Eigen::Vector3d& center_world, const Eigen::Vector3d& size_m, double yaw, PaintFunction paint) {
    AddBox({center_world, size_m, yaw}, With(paint, kThingTexels_per_m), lamp_, *scene_);
  }

  void AddTable() {
    constexpr double kTop_m = 0.74;
    const double yaw = rng_.Uniform(-0.4, 0.4);
    const Eigen::AngleAxisd R_world_table(yaw, Eigen::Vector3d::UnitZ());
    AddThing({0, 0, kTop_m - 0.02}, {1.2, 0.7, 0.04}, yaw, PaintPlanks);
    for (const double x_m : {-0.55, 0.55}) {
      for (const double y_m : {-0.3, 0.3}) {
        const double height_m = kTop_m - 0.04;
        AddThing(R_world_table * Eigen::Vector3d(x_m, y_m, 0.5 * height_m), {0.06, 0.06, height_m}, yaw, PaintPlanks);
      }
    }
    for (const double x_m : {-0.42, -0.05, 0.35}) {
      const Eigen::Vector3d size_m(rng_.Uniform(0.15, 0.28), rng_.Uniform(0.15, 0.3), rng_.Uniform(0.08, 0.3));
      const Eigen::Vector3d center_table(x_m, rng_.Uniform(-0.12, 0.12), kTop_m + 0.5 * size_m.z());
      AddThing(R_world_table * center_table, size_m, yaw + rng_.Uniform(-0.7, 0.7), PaintCarton);
    }
  }

  /// A tall piece, a low one and cartons on the floor, and posters in between.
  void FurnishWall(const Wall& wall, size_t wall_idx) {
    const double shelf_m = rng_.Uniform(0.8, 1.3);
    const bool shelf_left = wall_idx % 2 == 0;
    const double shelf_at_m = shelf_left ? 0.9 : wall.length_m - 0.9;
    AddAgainst(wall, shelf_at_m, {shelf_m, 0.3, rng_.Uniform(1.6, 2.2)}, 0, PaintBooks);
    const double low_at_m = shelf_left ? wall.length_m - 1.3 : 1.3;
    const double low_height_m = rng_.Uniform(0.6, 0.9);
    AddAgainst(wall, low_at_m, {rng_.Uniform(1.0, 1.4), 0.45, low_height_m}, 0, PaintPlanks);
    AddAgainst(wall, low_at_m - 0.25, {0.35, 0.3, rng_.Uniform(0.2, 0.35)}, low_height_m, PaintCarton);
    AddAgainst(wall, low_at_m + 0.25, {0.25, 0.25, rng_.Uniform(0.15, 0.4)}, low_height_m, PaintCarton);
    AddAgainst(wall, 0.5 * wall.length_m + rng_.Uniform(-0.2, 0.2), {0.5, 0.4, rng_.Uniform(0.35, 0.6)}, 0,
               PaintCarton);
    AddPoster(wall, 0.5 * wall.length_m + rng_.Uniform(-0.15, 0.15), 1.7, rng_.Uniform(0.6, 0.8),
              rng_.Uniform(0.8, 1.1));
    AddPoster(wall, low_at_m - 0.35, 1.75, rng_.Uniform(0.4, 0.55), rng_.Uniform(0.5, 0.8));
    AddPoster(wall, low_at_m + 0.35, 1.65, rng_.Uniform(0.4, 0.55), rng_.Uniform(0.5, 0.8));
    AddPoster(wall, shelf_at_m, 2.55, rng_.Uniform(0.5, 0.8), 0.35);
  }

  void AddAgainst(const Wall& wall, double along_m, const Eigen::Vector3d& size_m, double base_m, PaintFunction paint) {
    constexpr double kGap_m = 0.02;
    AddThing(wall.At(along_m, base_m + 0.5 * size_m.z(), kGap_m + 0.5 * size_m.y()), size_m, wall.Yaw(), paint);
  }

  void AddPoster(const Wall& wall, double center_along_m, double center_height_m, double width_m, double height_m) {
    constexpr double kThickness_m = 0.015;
    AddQuad(wall.At(center_along_m - 0.5 * width_m, center_height_m + 0.5 * height_m, kThickness_m),
            width_m * wall.right_world, {0, 0, -height_m}, With(PaintPoster, kPosterTexels_per_m), lamp_, *scene_);
  }

  Rng rng_;
  const Eigen::Vector3d size_m_;
  Lamp lamp_;
  std::shared_ptr<Scene> scene_ = std::make_shared<Scene>();
};

}  // namespace

StatusOr<std::shared_ptr<const Scene>> BuildRoom(uint64_t seed) {
  try {
    return RoomBuilder(seed).Build();
  } catch (const std::exception& exception) {  // OpenCV and the allocator: only for want of memory
    return absl::ResourceExhaustedError(fmt::format("drawing room {}: {}", seed, exception.what()));
  }
}

}  // namespace mapp::sim
