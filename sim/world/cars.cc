#include "sim/world/paint_cars.h"
#include "sim/world/things.h"

#include <array>
#include <cmath>

namespace mapp::sim {
namespace {

constexpr double kTexels_per_m = 200;
/// What closes a gap lies this much behind what it joins, so that the two do not flicker.
constexpr double kBehind_m = 0.002;

/// A car seen from its side: a body, and a cabin whose screens lean. x along the nose, from the middle.
struct CarShape {
  double length_m, width_m, body_m;    ///< of the body; `body_m` is its height
  double roof_m;                       ///< height of the roof
  double tail_foot_m, tail_top_m;      ///< where the rear window begins and ends
  double screen_top_m, screen_foot_m;  ///< where the windscreen begins and ends
};

constexpr std::array<CarShape, 4> kShapes = {{
    {4.45, 1.80, 0.92, 1.46, -1.75, -1.15, 0.35, 1.10},  // saloon
    {4.00, 1.75, 0.95, 1.50, -1.98, -1.70, 0.35, 1.05},  // hatchback
    {4.60, 1.85, 0.93, 1.50, -2.28, -1.95, 0.40, 1.15},  // estate
    {4.80, 1.92, 1.15, 1.95, -2.38, -2.30, 1.25, 1.75},  // van
}};
constexpr std::array<double, 3> kTones = {62, 128, 198};
constexpr double kCabinInset_m = 0.1;

struct Skin {
  Picture left, right, nose, tail, top, roof, windows, screen, rear;
};

Skin PaintSkin(const CarShape& car, double tone, Rng& rng) {
  const double cabin_m = car.screen_top_m - car.tail_top_m;
  const auto side = [&](const Canvas& canvas) { return PaintCarSide(canvas, tone, rng); };
  const auto screen = [&](const Canvas& canvas) { return PaintCarScreen(canvas, tone, rng); };
  Skin skin;
  skin.right = Draw({car.length_m, car.body_m, kTexels_per_m}, side);
  skin.left = Draw({car.length_m, car.body_m, kTexels_per_m}, side);
  skin.nose = Draw({car.width_m, car.body_m, kTexels_per_m},
                   [&](const Canvas& canvas) { return PaintCarEnd(canvas, tone, true, rng); });
  skin.tail = Draw({car.width_m, car.body_m, kTexels_per_m},
                   [&](const Canvas& canvas) { return PaintCarEnd(canvas, tone, false, rng); });
  skin.top = Draw({car.length_m, car.width_m, kTexels_per_m},
                  [&](const Canvas& canvas) { return PaintCarTop(canvas, tone, rng); });
  skin.roof = Draw({cabin_m, car.width_m - 2 * kCabinInset_m, kTexels_per_m},
                   [&](const Canvas& canvas) { return PaintCarRoof(canvas, tone, rng); });
  skin.windows = Draw({cabin_m, car.roof_m - car.body_m, kTexels_per_m},
                      [&](const Canvas& canvas) { return PaintCarWindows(canvas, tone, rng); });
  skin.screen = Draw({car.width_m - 2 * kCabinInset_m, 0.8, kTexels_per_m}, screen);
  skin.rear = Draw({car.width_m - 2 * kCabinInset_m, 0.6, kTexels_per_m}, screen);
  return skin;
}

/// The side below a leaning screen is a triangle; a rectangle along the lean that reaches down into the body covers it.
/// (x, z) of the screen's top and foot.
Rect LeanFiller(const Eigen::Vector2d& top, const Eigen::Vector2d& foot, double y_m) {
  const Eigen::Vector2d lean = foot - top;
  // From the middle of the cabin outwards the foot lies beyond the top: inwards is down and back.
  Eigen::Vector2d inwards(-lean.y(), lean.x());
  if (inwards.y() > 0) inwards = -inwards;
  const double depth_m = std::abs(lean.x() * lean.y()) / lean.norm();
  inwards = depth_m * inwards.normalized();
  const auto at = [](const Eigen::Vector2d& xz) { return Eigen::Vector3d(xz.x(), 0, xz.y()); };
  // Seen from outside u must run right and v down: swap them where that shows the back.
  const Eigen::Vector3d corner(top.x(), y_m, top.y());
  Rect rect{corner, at(lean), at(inwards)};
  const double faces = rect.edge_v.cross(rect.edge_u).y();
  if (faces * y_m < 0) rect = {corner, at(inwards), at(lean)};
  return rect;
}

void AddCabin(const CarShape& car, const Skin& skin, QuadMaker& maker) {
  const double half_m = 0.5 * car.width_m - kCabinInset_m;
  const double glass_m = car.roof_m - car.body_m;
  maker.Hang(FloorRect({car.tail_top_m, -half_m, car.roof_m}, {car.screen_top_m, half_m, car.roof_m}), skin.roof);
  maker.Hang(UprightRect({car.tail_top_m, -half_m, car.body_m}, {car.screen_top_m, -half_m, car.body_m}, glass_m),
             skin.windows);
  maker.Hang(UprightRect({car.screen_top_m, half_m, car.body_m}, {car.tail_top_m, half_m, car.body_m}, glass_m),
             skin.windows);
  const Eigen::Vector2d screen_top(car.screen_top_m, car.roof_m);
  const Eigen::Vector2d screen_foot(car.screen_foot_m, car.body_m);
  const Eigen::Vector2d tail_top(car.tail_top_m, car.roof_m);
  const Eigen::Vector2d tail_foot(car.tail_foot_m, car.body_m);
  const auto lean = [](const Eigen::Vector2d& top, const Eigen::Vector2d& foot) {
    return Eigen::Vector3d(foot.x() - top.x(), 0, foot.y() - top.y());
  };
  maker.Hang({{screen_top.x(), -half_m, screen_top.y()}, {0, 2 * half_m, 0}, lean(screen_top, screen_foot)},
             skin.screen);
  maker.Hang({{tail_top.x(), half_m, tail_top.y()}, {0, -2 * half_m, 0}, lean(tail_top, tail_foot)}, skin.rear);
  for (const double y_m : {-half_m + kBehind_m, half_m - kBehind_m}) {
    maker.Hang(LeanFiller(screen_top, screen_foot, y_m), skin.windows);
    maker.Hang(LeanFiller(tail_top, tail_foot, y_m), skin.windows);
  }
}

}  // namespace

Thing MakeCar(size_t model, uint64_t seed) {
  const CarShape& car = kShapes.at(model % kShapes.size());
  Rng rng(SeedOf(seed, 400 + model));
  const Skin skin = PaintSkin(car, kTones.at(model / kShapes.size()) + rng.Uniform(-20, 20), rng);
  Thing thing;
  thing.size_m = {car.length_m, car.width_m, car.roof_m};
  Materials unused(seed);  // all pictures are the car's own
  QuadMaker maker(unused, rng, thing.quads);
  const double x_m = 0.5 * car.length_m;
  const double y_m = 0.5 * car.width_m;
  maker.Hang(UprightRect({-x_m, -y_m, 0}, {x_m, -y_m, 0}, car.body_m), skin.right);
  maker.Hang(UprightRect({x_m, -y_m, 0}, {x_m, y_m, 0}, car.body_m), skin.nose);
  maker.Hang(UprightRect({x_m, y_m, 0}, {-x_m, y_m, 0}, car.body_m), skin.left);
  thing.quads.back().window = {1, 0, 0, 1};  // painted nose to the right
  maker.Hang(UprightRect({-x_m, y_m, 0}, {-x_m, -y_m, 0}, car.body_m), skin.tail);
  maker.Hang(FloorRect({-x_m, -y_m, car.body_m}, {x_m, y_m, car.body_m}), skin.top);
  AddCabin(car, skin, maker);
  return thing;
}

}  // namespace mapp::sim
