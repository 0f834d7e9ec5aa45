#include "sim/world/paint_cars.h"

#include "sim/sheet.h"

#include <algorithm>
#include <cmath>
#include <numbers>
#include <utility>

namespace mapp::sim {
namespace {

constexpr double kGlass = 38;
constexpr double kRubber = 22;

/// What reads on a lacquer as a line or a letter.
double Ink(double body) { return body < 110 ? body + 85 : body - 85; }

void Wheel(double x_m, double y_m, double radius_m, size_t num_spokes, Sheet& sheet) {
  sheet.Disc(x_m, y_m, 1.13 * radius_m, 12);
  sheet.Disc(x_m, y_m, radius_m, kRubber);
  sheet.Disc(x_m, y_m, 0.66 * radius_m, 185);
  for (size_t i = 0; i < num_spokes; ++i) {
    const double angle = 2 * std::numbers::pi * (static_cast<double>(i) + 0.25) / static_cast<double>(num_spokes);
    sheet.Line(x_m + 0.18 * radius_m * std::cos(angle), y_m + 0.18 * radius_m * std::sin(angle),
               x_m + 0.6 * radius_m * std::cos(angle), y_m + 0.6 * radius_m * std::sin(angle), 0.2 * radius_m, 45);
  }
  sheet.Disc(x_m, y_m, 0.14 * radius_m, 90);
}

/// Dust, splashes and reflections: what makes a lacquer more than a plain.
void Weather(double body, Rng& rng, Sheet& sheet) {
  const double w = sheet.width_m();
  const double h = sheet.height_m();
  for (int i = 0; i < 7; ++i) {
    const double y_m = rng.Uniform(0, h);
    sheet.Line(rng.Uniform(-0.2, 0.6) * w, y_m, rng.Uniform(0.4, 1.2) * w, y_m + rng.Uniform(-0.1, 0.1) * h,
               rng.Uniform(0.004, 0.03), std::clamp(body + rng.Uniform(-28, 40), 5.0, 250.0));
  }
  sheet.Stains(160, 34);
}

void NumberPlate(double x_m, double y_m, double width_m, Sheet& sheet) {
  const double height_m = 0.21 * width_m;
  sheet.Rectangle(x_m, y_m, width_m, height_m, 15);
  sheet.Rectangle(x_m + 0.008, y_m + 0.008, width_m - 0.016, height_m - 0.016, 225);
  sheet.Text(x_m + 0.035, y_m + 0.22 * height_m, width_m - 0.06, 0.58 * height_m, 15);
}

}  // namespace

GrayImage PaintCarSide(const Canvas& canvas, double body, Rng& rng) {
  const double w = canvas.width_m;
  const double h = canvas.height_m;
  Sheet sheet(canvas, body, rng);
  sheet.Rectangle(0, 0.5 * h, w, 0.5 * h, 0.85 * body);
  Weather(body, rng, sheet);
  for (const double door : {0.27, 0.5, 0.7}) {
    sheet.Line(door * w, 0, (door + 0.01) * w, 0.78 * h, 0.012, 0.35 * body);
    sheet.Rectangle((door - 0.07) * w, 0.16 * h, 0.16, 0.035, Ink(body));
  }
  sheet.Line(0.02 * w, rng.Uniform(0.25, 0.35) * h, 0.98 * w, rng.Uniform(0.25, 0.35) * h, 0.012, Ink(body));
  sheet.Rectangle(0.2 * w, 0.6 * h, 0.6 * w, 0.045, 40);
  if (rng.Uniform() < 0.5) sheet.Text(0.52 * w, 0.38 * h, 0.7, 0.1, Ink(body));
  sheet.Rectangle(0, 0.8 * h, w, 0.2 * h, 14);  // the shade beneath
  sheet.Rectangle(0.0, 0.12 * h, 0.2, 0.12 * h, 205);
  sheet.Rectangle(w - 0.28, 0.14 * h, 0.28, 0.13 * h, 235);
  const double radius_m = 0.3;
  const auto num_spokes = 5 + rng.Below(5);
  for (const double axle : {0.19, 0.81}) Wheel(axle * w, h - radius_m, radius_m, num_spokes, sheet);
  sheet.Rectangle(0.1 * w, 0.02 * h, 0.14, 0.14, 0.7 * body);  // the filler's lid
  sheet.Grain(0.08, 4);
  return std::move(sheet).Take();
}

GrayImage PaintCarEnd(const Canvas& canvas, double body, bool is_nose, Rng& rng) {
  const double w = canvas.width_m;
  const double h = canvas.height_m;
  Sheet sheet(canvas, body, rng);
  Weather(body, rng, sheet);
  sheet.Line(0, 0.12 * h, w, 0.12 * h, 0.012, 0.4 * body);
  const double lamp = is_nose ? 240 : 70;
  for (const double x : {0.03, 0.75}) {
    sheet.Rectangle(x * w, 0.17 * h, 0.22 * w, 0.16 * h, 30);
    sheet.Rectangle((x + 0.01) * w, 0.19 * h, 0.2 * w, 0.12 * h, lamp);
    sheet.Disc((x + 0.07) * w, 0.25 * h, 0.05 * h, is_nose ? 170 : 190);
    sheet.Disc((x + 0.15) * w, 0.25 * h, 0.04 * h, is_nose ? 120 : 25);
  }
  if (is_nose) {
    sheet.Rectangle(0.28 * w, 0.18 * h, 0.44 * w, 0.18 * h, 25);
    const double step_m = rng.Uniform(0.02, 0.045);
    for (double y_m = 0.19 * h; y_m < 0.35 * h; y_m += step_m) sheet.Line(0.3 * w, y_m, 0.7 * w, y_m, 0.008, 150);
  } else {
    sheet.Text(0.3 * w, 0.2 * h, 0.35 * w, 0.07, Ink(body));
  }
  sheet.Disc(0.5 * w, 0.2 * h, 0.05, 215);
  sheet.Rectangle(0, 0.55 * h, w, 0.06 * h, 0.55 * body);
  NumberPlate(0.5 * w - 0.26, 0.44 * h, 0.52, sheet);
  sheet.Rectangle(0.2 * w, 0.64 * h, 0.6 * w, 0.1 * h, 30);
  sheet.Rectangle(0, 0.8 * h, w, 0.2 * h, 12);
  for (const double x : {0.04, 0.83}) sheet.Rectangle(x * w, 0.72 * h, 0.13 * w, 0.28 * h, kRubber);
  sheet.Grain(0.08, 4);
  return std::move(sheet).Take();
}

GrayImage PaintCarTop(const Canvas& canvas, double body, Rng& rng) {
  const double w = canvas.width_m;
  const double h = canvas.height_m;
  Sheet sheet(canvas, std::min(body + 12, 250.0), rng);
  Weather(body, rng, sheet);
  for (const double y : {0.12, 0.88}) sheet.Line(0, y * h, w, y * h, 0.012, 0.45 * body);
  for (const double y : {0.3, 0.7})
    sheet.Line(0.72 * w, y * h, 0.98 * w, (y < 0.5 ? 0.38 : 0.62) * h, 0.015, Ink(body));
  sheet.Rectangle(0.7 * w, 0.15 * h, 0.03, 0.7 * h, 25);
  sheet.Grain(0.1, 4);
  return std::move(sheet).Take();
}

GrayImage PaintCarRoof(const Canvas& canvas, double body, Rng& rng) {
  const double w = canvas.width_m;
  const double h = canvas.height_m;
  Sheet sheet(canvas, body, rng);
  Weather(body, rng, sheet);
  for (const double y : {0.08, 0.92}) sheet.Line(0, y * h, w, y * h, 0.025, 35);
  if (rng.Uniform() < 0.5) sheet.Rectangle(0.5 * w, 0.22 * h, 0.3 * w, 0.56 * h, kGlass);
  sheet.Disc(0.1 * w, 0.5 * h, 0.03, 20);
  sheet.Grain(0.1, 4);
  return std::move(sheet).Take();
}

GrayImage PaintCarWindows(const Canvas& canvas, double body, Rng& rng) {
  const double w = canvas.width_m;
  const double h = canvas.height_m;
  Sheet sheet(canvas, body, rng);
  sheet.Rectangle(0.03 * w, 0.1 * h, 0.94 * w, 0.86 * h, kGlass);
  for (int i = 0; i < 6; ++i) {  // what shines in the glass, and seats behind
    const double x_m = rng.Uniform(0.05, 0.9) * w;
    sheet.Line(x_m, 0.95 * h, x_m + rng.Uniform(0.05, 0.3), 0.12 * h, rng.Uniform(0.01, 0.06), rng.Uniform(50, 95));
  }
  for (const double x : {0.22, 0.62}) sheet.Rectangle(x * w, 0.4 * h, 0.1 * w, 0.56 * h, 18);
  sheet.Rectangle(0.47 * w, 0, 0.05 * w, h, body);
  sheet.Stains(120, 25);
  sheet.Grain(0.1, 4);
  return std::move(sheet).Take();
}

GrayImage PaintCarScreen(const Canvas& canvas, double body, Rng& rng) {
  const double w = canvas.width_m;
  const double h = canvas.height_m;
  Sheet sheet(canvas, body, rng);
  sheet.Rectangle(0.04 * w, 0.06 * h, 0.92 * w, 0.9 * h, kGlass);
  for (int i = 0; i < 6; ++i) {
    const double x_m = rng.Uniform(0.05, 0.8) * w;
    sheet.Line(x_m, 0.95 * h, x_m + rng.Uniform(0.05, 0.4), 0.08 * h, rng.Uniform(0.01, 0.08), rng.Uniform(50, 100));
  }
  for (const double x : {0.18, 0.64}) sheet.Rectangle(x * w, 0.3 * h, 0.16 * w, 0.5 * h, 17);
  sheet.Line(0.1 * w, 0.94 * h, 0.46 * w, 0.8 * h, 0.02, 10);
  sheet.Line(0.5 * w, 0.94 * h, 0.86 * w, 0.8 * h, 0.02, 10);
  sheet.Rectangle(0.06 * w, 0.78 * h, 0.12, 0.09, 215);  // a permit behind the glass
  sheet.Text(0.06 * w + 0.01, 0.78 * h + 0.02, 0.09, 0.03, 30);
  sheet.Stains(120, 25);
  sheet.Grain(0.1, 4);
  return std::move(sheet).Take();
}

}  // namespace mapp::sim
