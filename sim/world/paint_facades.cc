#include "sim/sheet.h"
#include "sim/world/paint_places.h"

#include <algorithm>
#include <cmath>
#include <utility>

namespace mapp::sim {
namespace {

/// Glass with what shines in it, curtains or things behind.
void Glass(double x_m, double y_m, double width_m, double height_m, Rng& rng, Sheet& sheet) {
  sheet.Rectangle(x_m, y_m, width_m, height_m, rng.Uniform(35, 70));
  if (rng.Uniform() < 0.6) {
    sheet.Rectangle(x_m, y_m, rng.Uniform(0.15, 0.4) * width_m, height_m, rng.Uniform(120, 190));
  }
  for (int i = 0; i < 3; ++i) {
    sheet.Rectangle(x_m + rng.Uniform(0, 0.8) * width_m, y_m + rng.Uniform(0.5, 0.8) * height_m, 0.15 * width_m,
                    0.2 * height_m, rng.Uniform(20, 170));
  }
}

/// A window with frame, casements and sill in the middle of a wall, and the band between storeys.
void Window(int num_casements, double frame, Rng& rng, Sheet& sheet) {
  const double w = sheet.width_m();
  const double h = sheet.height_m();
  const double left_m = 0.25 * w;
  const double top_m = 0.2 * h;
  const double wide_m = 0.5 * w;
  const double tall_m = 0.56 * h;
  sheet.Rectangle(left_m - 0.14, top_m - 0.14, wide_m + 0.28, tall_m + 0.28, frame);
  sheet.Rectangle(left_m - 0.04, top_m - 0.04, wide_m + 0.08, tall_m + 0.08, 45);
  for (int i = 0; i < num_casements; ++i) {
    const double casement_m = wide_m / num_casements;
    const double x_m = left_m + i * casement_m;
    sheet.Rectangle(x_m, top_m, casement_m, tall_m, 215);
    Glass(x_m + 0.05, top_m + 0.05, casement_m - 0.1, 0.3 * tall_m - 0.07, rng, sheet);
    Glass(x_m + 0.05, top_m + 0.3 * tall_m + 0.03, casement_m - 0.1, 0.7 * tall_m - 0.08, rng, sheet);
  }
  sheet.Rectangle(left_m - 0.2, top_m + tall_m + 0.06, wide_m + 0.4, 0.1, 205);
  sheet.Rectangle(left_m - 0.2, top_m + tall_m + 0.16, wide_m + 0.4, 0.04, 50);
  sheet.Rectangle(0, h - 0.1, w, 0.1, 110);
}

}  // namespace

GrayImage PaintLightBay(const Canvas& canvas, Rng& rng) {
  Sheet sheet(canvas, 190, rng);
  sheet.Stains(190, 48);
  Window(2, 228, rng, sheet);
  sheet.Grain(0.4, 8);
  return std::move(sheet).Take();
}

GrayImage PaintBrickBay(const Canvas& canvas, Rng& rng) {
  constexpr double kCourse_m = 0.1;
  Sheet sheet(canvas, 165, rng);
  for (int course = 0; course * kCourse_m < canvas.height_m - 1e-6; ++course) {
    for (double x_m = course % 2 == 0 ? 0 : -0.15; x_m < canvas.width_m; x_m += 0.3) {
      sheet.Rectangle(x_m, course * kCourse_m, 0.285, kCourse_m - 0.015, rng.Uniform(80, 128));
    }
  }
  sheet.Stains(90, 45);
  Window(3, 215, rng, sheet);
  sheet.Grain(0.4, 8);
  return std::move(sheet).Take();
}

GrayImage PaintDarkBay(const Canvas& canvas, Rng& rng) {
  Sheet sheet(canvas, 100, rng);
  sheet.Stains(190, 48);
  for (double y_m = 0.4; y_m < canvas.height_m; y_m += 0.5) sheet.Rectangle(0, y_m, canvas.width_m, 0.025, 60);
  Window(2, 195, rng, sheet);
  sheet.Grain(0.4, 8);
  return std::move(sheet).Take();
}

GrayImage PaintPanelBay(const Canvas& canvas, Rng& rng) {
  constexpr double kPanel_m = 0.75;
  Sheet sheet(canvas, 60, rng);
  for (double y_m = 0; y_m < canvas.height_m - 1e-6; y_m += kPanel_m) {
    for (double x_m = 0; x_m < canvas.width_m - 1e-6; x_m += kPanel_m) {
      sheet.Rectangle(x_m, y_m, kPanel_m - 0.02, kPanel_m - 0.02, rng.Uniform(138, 172));
    }
  }
  sheet.Stains(170, 48);
  Window(4, 70, rng, sheet);
  sheet.Grain(0.4, 8);
  return std::move(sheet).Take();
}

GrayImage PaintShopFront(const Canvas& canvas, Rng& rng) {
  const double w = canvas.width_m;
  const double h = canvas.height_m;
  Sheet sheet(canvas, rng.Uniform(60, 150), rng);
  sheet.Stains(120, 40);
  const double board_m = 0.2 * h;
  const double board = rng.Uniform() < 0.5 ? 35 : 215;
  sheet.Rectangle(0.03 * w, 0.03 * h, 0.94 * w, board_m, board);
  sheet.Text(0.08 * w, 0.07 * h, 0.8 * w, 0.55 * board_m, board < 100 ? 225 : 30);
  const double door_x_m = rng.Uniform() < 0.5 ? 0.06 * w : 0.7 * w;
  const double pane_x_m = door_x_m < 0.5 * w ? 0.36 * w : 0.05 * w;
  sheet.Rectangle(pane_x_m, 0.3 * h, 0.58 * w, 0.55 * h, 200);
  for (const double at : {0.01, 0.3}) {
    const double x_m = pane_x_m + at * w;
    sheet.Rectangle(x_m, 0.32 * h, 0.27 * w, 0.51 * h, 45);
    for (int i = 0; i < 3; ++i) {  // goods on shelves
      sheet.Drawing(x_m + 0.01 * w, (0.34 + 0.16 * i) * h, 0.25 * w, 0.14 * h);
      sheet.Rectangle(x_m, (0.485 + 0.16 * i) * h, 0.27 * w, 0.02, 150);
    }
  }
  sheet.Text(pane_x_m + 0.05 * w, 0.34 * h, 0.4 * w, 0.12, 235);
  sheet.Rectangle(door_x_m, 0.28 * h, 0.25 * w, 0.72 * h, 190);
  Glass(door_x_m + 0.04 * w, 0.33 * h, 0.17 * w, 0.55 * h, rng, sheet);
  sheet.Rectangle(door_x_m + 0.19 * w, 0.6 * h, 0.03, 0.25, 20);
  sheet.Text(door_x_m + 0.06 * w, 0.5 * h, 0.1 * w, 0.06, 240);
  sheet.Grain(0.2, 6);
  return std::move(sheet).Take();
}

GrayImage PaintDoor(const Canvas& canvas, Rng& rng) {
  const double w = canvas.width_m;
  const double h = canvas.height_m;
  Sheet sheet(canvas, 60, rng);
  const double leaf = rng.Uniform(110, 190);
  sheet.Rectangle(0.06 * w, 0.03 * h, 0.88 * w, 0.97 * h, leaf);
  sheet.Stains(200, 45);
  for (const double y : {0.12, 0.58}) {
    sheet.Rectangle(0.18 * w, y * h, 0.64 * w, 0.32 * h, leaf - 40);
    sheet.Rectangle(0.2 * w, (y + 0.01) * h, 0.6 * w, 0.3 * h, leaf + 15);
  }
  sheet.Rectangle(0.3 * w, 0.18 * h, 0.4 * w, 0.12 * h, 225);
  sheet.Text(0.33 * w, 0.21 * h, 0.34 * w, 0.05 * h, 30);
  sheet.Disc(0.84 * w, 0.53 * h, 0.035, 25);
  sheet.Line(0.84 * w, 0.53 * h, 0.72 * w, 0.53 * h, 0.025, 25);
  sheet.Grain(0.2, 6);
  return std::move(sheet).Take();
}

GrayImage PaintMachinePanel(const Canvas& canvas, Rng& rng) {
  const double w = canvas.width_m;
  const double h = canvas.height_m;
  Sheet sheet(canvas, rng.Uniform(95, 165), rng);
  sheet.Stains(150, 45);
  const auto num_covers = static_cast<int>(2 + std::lround(1.5 * w * h));
  for (int i = 0; i < num_covers; ++i) {
    const double x_m = rng.Uniform(0.02, 0.7) * w;
    const double y_m = rng.Uniform(0.02, 0.75) * h;
    const double wide_m = rng.Uniform(0.15, 0.5);
    const double tall_m = rng.Uniform(0.15, 0.5);
    sheet.Rectangle(x_m, y_m, wide_m, tall_m, 30);
    sheet.Rectangle(x_m + 0.012, y_m + 0.012, wide_m - 0.024, tall_m - 0.024, rng.Uniform(90, 200));
    for (const double sx : {0.03, wide_m - 0.03}) {
      for (const double sy : {0.03, tall_m - 0.03}) sheet.Disc(x_m + sx, y_m + sy, 0.01, 40);
    }
    switch (rng.Below(4)) {
      case 0:  // a dial
        sheet.Disc(x_m + 0.5 * wide_m, y_m + 0.5 * tall_m, 0.3 * std::min(wide_m, tall_m), 235);
        sheet.Line(x_m + 0.5 * wide_m, y_m + 0.5 * tall_m, x_m + 0.65 * wide_m, y_m + 0.35 * tall_m, 0.01, 20);
        break;
      case 1:  // slots
        for (double at_m = 0.05; at_m < tall_m - 0.05; at_m += 0.035) {
          sheet.Rectangle(x_m + 0.05, y_m + at_m, wide_m - 0.1, 0.016, 25);
        }
        break;
      case 2:  // switches
        for (double at_m = 0.06; at_m < wide_m - 0.05; at_m += 0.06) {
          sheet.Disc(x_m + at_m, y_m + 0.4 * tall_m, 0.018, rng.Uniform(10, 245));
          sheet.Rectangle(x_m + at_m - 0.015, y_m + 0.6 * tall_m, 0.03, 0.012, 20);
        }
        break;
      default:
        sheet.Paragraph(x_m + 0.03, y_m + 0.04, wide_m - 0.05, tall_m - 0.06, 0.03, 25);
    }
  }
  sheet.Text(0.1 * w, 0.84 * h, 0.5 * w, std::min(0.12 * h, 0.16), rng.Uniform() < 0.5 ? 25 : 230);
  sheet.Grain(0.3, 7);
  return std::move(sheet).Take();
}

GrayImage PaintSheetMetal(const Canvas& canvas, Rng& rng) {
  constexpr double kWave_m = 0.12;
  Sheet sheet(canvas, rng.Uniform(110, 160), rng);
  sheet.Stains(170, 50);
  for (double x_m = 0; x_m < canvas.width_m; x_m += kWave_m) {
    sheet.Rectangle(x_m, 0, 0.3 * kWave_m, canvas.height_m, rng.Uniform(70, 95));
    sheet.Rectangle(x_m + 0.5 * kWave_m, 0, 0.2 * kWave_m, canvas.height_m, rng.Uniform(165, 195));
    for (double y_m = 0.1; y_m < canvas.height_m; y_m += 0.8) sheet.Disc(x_m + 0.6 * kWave_m, y_m, 0.012, 30);
  }
  sheet.Stains(90, 55);
  sheet.Grain(0.5, 9);
  return std::move(sheet).Take();
}

GrayImage PaintLadder(const Canvas& canvas, Rng& rng) {
  const double w = canvas.width_m;
  Sheet sheet(canvas, 40, rng);
  sheet.Stains(250, 25);
  for (double y_m = 0.1; y_m < canvas.height_m; y_m += 0.28) sheet.Rectangle(0, y_m, w, 0.04, rng.Uniform(160, 215));
  for (const double x : {0.0, 0.9}) sheet.Rectangle(x * w, 0, 0.1 * w, canvas.height_m, 190);
  sheet.Grain(0.1, 6);
  return std::move(sheet).Take();
}

GrayImage PaintPanes(const Canvas& canvas, Rng& rng) {
  constexpr double kPane_m = 0.5;
  Sheet sheet(canvas, 45, rng);
  for (double y_m = 0; y_m < canvas.height_m - 1e-6; y_m += kPane_m) {
    for (double x_m = 0; x_m < canvas.width_m - 1e-6; x_m += kPane_m) {
      const double level = rng.Uniform() < 0.12 ? rng.Uniform(70, 130) : rng.Uniform(195, 245);
      sheet.Rectangle(x_m + 0.025, y_m + 0.025, kPane_m - 0.05, kPane_m - 0.05, level);
    }
  }
  sheet.Stains(70, 50);
  sheet.Grain(0.3, 6);
  return std::move(sheet).Take();
}

}  // namespace mapp::sim
