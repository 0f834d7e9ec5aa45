#include "sim/world/paint_places.h"

#include "sim/sheet.h"

#include <algorithm>
#include <cmath>
#include <utility>

namespace mapp::sim {
namespace {

/// A crooked line that forks now and then.
void Crack(double x_m, double y_m, double length_m, double level, Rng& rng, Sheet& sheet) {
  double heading = rng.Uniform(0, 6.28);
  for (double left_m = length_m; left_m > 0;) {
    const double step_m = rng.Uniform(0.04, 0.14);
    heading += rng.Uniform(-0.7, 0.7);
    const double to_x_m = x_m + step_m * std::cos(heading);
    const double to_y_m = y_m + step_m * std::sin(heading);
    sheet.Line(x_m, y_m, to_x_m, to_y_m, 0.006, level);
    x_m = to_x_m;
    y_m = to_y_m;
    left_m -= step_m;
  }
}

void Cracks(double per_m2, double level, Rng& rng, Sheet& sheet) {
  const double w = sheet.width_m();
  const double h = sheet.height_m();
  for (auto left = std::llround(per_m2 * w * h); left > 0; --left) {
    Crack(rng.Uniform(0, w), rng.Uniform(0, h), rng.Uniform(0.3, 1.5), level, rng, sheet);
  }
}

}  // namespace

GrayImage PaintAsphalt(const Canvas& canvas, Rng& rng) {
  const double w = canvas.width_m;
  const double h = canvas.height_m;
  Sheet sheet(canvas, 92, rng);
  for (int i = 0; i < 2; ++i) {  // mended places
    const double x_m = rng.Uniform(0, 0.8) * w;
    const double y_m = rng.Uniform(0, 0.8) * h;
    sheet.Rectangle(x_m, y_m, rng.Uniform(0.3, 1.2), rng.Uniform(0.3, 1.2), rng.Uniform(60, 118));
  }
  sheet.Stains(330, 52);
  Cracks(0.5, 38, rng, sheet);
  for (int i = 0; i < 3; ++i) sheet.Patch(rng.Uniform(0, w), rng.Uniform(0, h), rng.Uniform(0.05, 0.22), 45);  // oil
  sheet.Grain(0.5, 11);
  return std::move(sheet).Take();
}

GrayImage PaintPaving(const Canvas& canvas, Rng& rng) {
  constexpr double kCourse_m = 0.25;
  constexpr double kJoint_m = 0.012;
  Sheet sheet(canvas, 70, rng);
  int course = 0;
  for (double y_m = 0; y_m < canvas.height_m - 1e-6; y_m += kCourse_m, ++course) {
    for (double x_m = course % 2 == 0 ? 0 : -0.25; x_m < canvas.width_m; x_m += 0.5) {
      const bool odd_one = rng.Uniform() < 0.12;
      sheet.Rectangle(x_m, y_m, 0.5 - kJoint_m, kCourse_m - kJoint_m,
                      odd_one ? rng.Uniform(80, 110) : rng.Uniform(125, 178));
    }
  }
  sheet.Stains(230, 55);
  Cracks(0.15, 60, rng, sheet);
  sheet.Grain(0.3, 9);
  return std::move(sheet).Take();
}

GrayImage PaintPlaster(const Canvas& canvas, Rng& rng) {
  const double w = canvas.width_m;
  const double h = canvas.height_m;
  Sheet sheet(canvas, rng.Uniform(135, 185), rng);
  for (int i = 0; i < 4; ++i) {
    sheet.Patch(rng.Uniform(0, w), rng.Uniform(0, h), rng.Uniform(0.15, 0.6), rng.Uniform(100, 190));
  }
  sheet.Stains(210, 52);
  Cracks(0.35, 70, rng, sheet);
  if (rng.Uniform() < 0.5) {
    const double size_m = rng.Uniform(0.12, 0.3);
    sheet.Text(rng.Uniform(0, 0.5) * w, rng.Uniform(0.4, 0.8) * h, 1.2, size_m, rng.Uniform(20, 70));
  }
  sheet.Grain(0.7, 9);
  return std::move(sheet).Take();
}

GrayImage PaintMasonry(const Canvas& canvas, Rng& rng) {
  constexpr double kCourse_m = 0.1;
  constexpr double kBrick_m = 0.25;
  constexpr double kMortar_m = 0.014;
  Sheet sheet(canvas, 178, rng);
  int course = 0;
  for (double y_m = 0; y_m < canvas.height_m - 1e-6; y_m += kCourse_m, ++course) {
    for (double x_m = course % 2 == 0 ? 0 : -0.5 * kBrick_m; x_m < canvas.width_m; x_m += kBrick_m) {
      const double level = rng.Uniform() < 0.1 ? rng.Uniform(45, 70) : rng.Uniform(75, 145);
      sheet.Rectangle(x_m, y_m, kBrick_m - kMortar_m, kCourse_m - kMortar_m, level);
    }
  }
  sheet.Stains(150, 55);
  sheet.Grain(0.4, 10);
  return std::move(sheet).Take();
}

GrayImage PaintRoof(const Canvas& canvas, Rng& rng) {
  constexpr double kLane_m = 1.0;
  const double w = canvas.width_m;
  Sheet sheet(canvas, 75, rng);
  for (double y_m = 0; y_m < canvas.height_m - 1e-6; y_m += kLane_m) {
    sheet.Rectangle(0, y_m, w, kLane_m, rng.Uniform(70, 130));
    sheet.Line(0, y_m, w, y_m, 0.02, 40);
    sheet.Line(rng.Uniform(0, w), y_m, rng.Uniform(0, w), y_m + rng.Uniform(0.2, kLane_m), 0.03, 45);
  }
  for (int i = 0; i < 5; ++i) {
    sheet.Patch(rng.Uniform(0, w), rng.Uniform(0, canvas.height_m), rng.Uniform(0.1, 0.6), rng.Uniform(45, 165));
  }
  sheet.Stains(230, 55);
  sheet.Grain(0.5, 10);
  return std::move(sheet).Take();
}

GrayImage PaintFoliage(const Canvas& canvas, Rng& rng) {
  Sheet sheet(canvas, 28, rng);
  for (auto left = std::llround(420 * canvas.width_m * canvas.height_m); left > 0; --left) {
    sheet.Patch(rng.Uniform(0, canvas.width_m), rng.Uniform(0, canvas.height_m), rng.Uniform(0.02, 0.1),
                rng.Uniform(30, 165));
  }
  sheet.Grain(0.2, 6);
  return std::move(sheet).Take();
}

GrayImage PaintStripes(const Canvas& canvas, Rng& rng) {
  constexpr double kStripe_m = 0.16;
  const double h = canvas.height_m;
  Sheet sheet(canvas, 205, rng);
  for (double x_m = -h; x_m < canvas.width_m + h; x_m += 2 * kStripe_m) {
    sheet.Triangle(x_m, h, x_m + h, 0, x_m + h + kStripe_m, 0, 25);
    sheet.Triangle(x_m, h, x_m + h + kStripe_m, 0, x_m + kStripe_m, h, 25);
  }
  sheet.Stains(250, 60);
  sheet.Grain(0.2, 7);
  return std::move(sheet).Take();
}

GrayImage PaintCloth(const Canvas& canvas, Rng& rng) {
  const double w = canvas.width_m;
  const double h = canvas.height_m;
  Sheet sheet(canvas, rng.Uniform(40, 190), rng);
  sheet.Stains(500, 40);
  sheet.Drawing(0.2 * w, 0.2 * h, 0.6 * w, 0.35 * h);
  for (int i = 0; i < 4; ++i) {
    const double x_m = rng.Uniform(0, w);
    sheet.Line(x_m, 0, x_m + rng.Uniform(-0.08, 0.08), h, 0.008, rng.Uniform(20, 90));
  }
  sheet.Grain(0.1, 8);
  return std::move(sheet).Take();
}

GrayImage PaintSign(const Canvas& canvas, const std::string& text, Rng& rng) {
  const double w = canvas.width_m;
  const double h = canvas.height_m;
  Sheet sheet(canvas, 25, rng);
  sheet.Rectangle(0.04 * h, 0.04 * h, w - 0.08 * h, 0.92 * h, 220);
  const double glyph_m =
      std::min(0.6 * h, 1.05 * (w - 0.2 * h) / static_cast<double>(std::max<size_t>(text.size(), 1)));
  sheet.Print(text, 0.12 * h, 0.5 * (h - glyph_m), glyph_m, 20);
  sheet.Stains(200, 35);
  sheet.Grain(0.1, 4);
  return std::move(sheet).Take();
}

GrayImage PaintArrow(const Canvas& canvas, Rng& rng) {
  constexpr double kPaint = 198;
  const double w = canvas.width_m;
  const double h = canvas.height_m;
  Sheet sheet(canvas, 92, rng);
  sheet.Rectangle(0.04 * w, 0.4 * h, 0.6 * w, 0.2 * h, kPaint);
  sheet.Triangle(0.6 * w, 0.08 * h, 0.6 * w, 0.92 * h, 0.97 * w, 0.5 * h, kPaint);
  sheet.Stains(420, 55);
  sheet.Grain(0.4, 10);
  return std::move(sheet).Take();
}

GrayImage PaintRoadLine(const Canvas& canvas, Rng& rng) {
  Sheet sheet(canvas, 200, rng);
  sheet.Stains(700, 65);
  Cracks(1.0, 90, rng, sheet);
  sheet.Grain(0.2, 9);
  return std::move(sheet).Take();
}

GrayImage PaintTube(const Canvas& canvas, Rng& rng) {
  const double w = canvas.width_m;
  const double h = canvas.height_m;
  Sheet sheet(canvas, 120, rng);
  for (const double y : {0.18, 0.58}) sheet.Rectangle(0.03 * w, y * h, 0.94 * w, 0.25 * h, 250);
  for (const double x : {0.01, 0.96}) sheet.Rectangle(x * w, 0.1 * h, 0.03 * w, 0.8 * h, 60);
  return std::move(sheet).Take();
}

}  // namespace mapp::sim
