#include "sim/paint.h"

#include "sim/sheet.h"

#include <algorithm>
#include <utility>

namespace mapp::sim {

GrayImage PaintBricks(const Canvas& canvas, Rng& rng) {
  constexpr double kMortar_m = 0.012;
  Sheet sheet(canvas, 185, rng);
  for (double y_m = 0; y_m < canvas.height_m;) {
    const double course_m = rng.Uniform(0.07, 0.12);
    for (double x_m = -rng.Uniform(0, 0.2); x_m < canvas.width_m;) {
      const double length_m = rng.Uniform(0.12, 0.34);
      sheet.Rectangle(x_m, y_m, length_m - kMortar_m, course_m - kMortar_m, rng.Uniform(65, 165));
      x_m += length_m;
    }
    y_m += course_m;
  }
  sheet.Stains(140, 60);
  sheet.Grain(0.4, 11);
  return std::move(sheet).Take();
}

GrayImage PaintConcrete(const Canvas& canvas, Rng& rng) {
  constexpr double kSeam_m = 0.008;
  Sheet sheet(canvas, 140, rng);
  for (double x_m = 0; x_m < canvas.width_m;) {
    const double panel_width_m = rng.Uniform(0.7, 1.3);
    for (double y_m = 0; y_m < canvas.height_m;) {
      const double panel_height_m = rng.Uniform(0.6, 1.2);
      sheet.Rectangle(x_m, y_m, panel_width_m - kSeam_m, panel_height_m - kSeam_m, rng.Uniform(125, 175));
      for (const double edge_m : {0.12, panel_width_m - 0.12}) {
        sheet.Disc(x_m + edge_m, y_m + rng.Uniform(0.1, panel_height_m - 0.1), rng.Uniform(0.012, 0.03), 45);
      }
      sheet.Text(x_m + rng.Uniform(0.05, 0.3), y_m + rng.Uniform(0.05, 0.4), 0.4, rng.Uniform(0.05, 0.12), 80);
      y_m += panel_height_m;
    }
    x_m += panel_width_m;
  }
  sheet.Stains(220, 65);
  sheet.Grain(0.6, 10);
  return std::move(sheet).Take();
}

GrayImage PaintPlates(const Canvas& canvas, Rng& rng) {
  constexpr double kSeam_m = 0.01;
  Sheet sheet(canvas, 70, rng);
  for (double y_m = 0; y_m < canvas.height_m;) {
    const double plate_height_m = rng.Uniform(0.35, 0.7);
    for (double x_m = -rng.Uniform(0, 0.5); x_m < canvas.width_m;) {
      const double plate_width_m = rng.Uniform(0.4, 0.9);
      sheet.Rectangle(x_m, y_m, plate_width_m - kSeam_m, plate_height_m - kSeam_m, rng.Uniform(120, 190));
      for (double screw_m = 0.05; screw_m < plate_width_m - 0.04; screw_m += rng.Uniform(0.08, 0.2)) {
        sheet.Disc(x_m + screw_m, y_m + 0.03, 0.01, rng.Uniform(30, 90));
        sheet.Disc(x_m + screw_m, y_m + plate_height_m - 0.04, 0.01, rng.Uniform(30, 90));
      }
      x_m += plate_width_m;
    }
    y_m += plate_height_m;
  }
  sheet.Stains(160, 60);
  sheet.Grain(0.5, 9);
  return std::move(sheet).Take();
}

GrayImage PaintPlanks(const Canvas& canvas, Rng& rng) {
  constexpr double kGap_m = 0.005;
  Sheet sheet(canvas, 35, rng);
  for (double y_m = 0; y_m < canvas.height_m;) {
    const double board_m = rng.Uniform(0.08, 0.16);
    for (double x_m = -rng.Uniform(0, 0.8); x_m < canvas.width_m;) {
      const double length_m = rng.Uniform(0.5, 1.6);
      const double level = rng.Uniform(85, 175);
      sheet.Rectangle(x_m, y_m, length_m - kGap_m, board_m - kGap_m, level);
      for (int i = 0; i < 7; ++i) {
        const double grain_m = y_m + rng.Uniform(0.01, board_m - 0.01);
        const double from_m = x_m + rng.Uniform(0, 0.7) * length_m;
        sheet.Line(from_m, grain_m, std::min(from_m + rng.Uniform(0.1, 0.5), x_m + length_m - kGap_m), grain_m, 0.003,
                   level - rng.Uniform(15, 45));
      }
      for (auto knots = rng.Below(3); knots > 0; --knots) {
        const double radius_m = rng.Uniform(0.006, 0.02);
        sheet.Disc(x_m + rng.Uniform(0.05, length_m), y_m + rng.Uniform(0.03, board_m - 0.03), radius_m, level - 60);
      }
      x_m += length_m;
    }
    y_m += board_m;
  }
  sheet.Stains(120, 50);
  sheet.Grain(0.3, 8);
  return std::move(sheet).Take();
}

GrayImage PaintPoster(const Canvas& canvas, Rng& rng) {
  const bool dark = rng.Uniform() < 0.35;
  const double paper = dark ? rng.Uniform(25, 60) : rng.Uniform(190, 235);
  const double ink = dark ? rng.Uniform(190, 240) : rng.Uniform(10, 60);
  const double w = canvas.width_m;
  const double h = canvas.height_m;
  Sheet sheet(canvas, ink, rng);  // the frame
  sheet.Rectangle(0.015, 0.015, w - 0.03, h - 0.03, paper);
  sheet.Text(0.07 * w, 0.06 * h, 0.8 * w, 0.09 * h, ink);
  const double drawing_m = rng.Uniform(0.3, 0.5) * h;
  sheet.Rectangle(0.07 * w, 0.2 * h, 0.86 * w, drawing_m, rng.Uniform(80, 170));
  sheet.Drawing(0.07 * w, 0.2 * h, 0.86 * w, drawing_m);
  const double text_top_m = 0.23 * h + drawing_m;
  for (const double column : {0.07, 0.53}) {
    sheet.Paragraph(column * w, text_top_m, 0.4 * w, 0.93 * h - text_top_m, rng.Uniform(0.018, 0.03) * h, ink);
  }
  sheet.Grain(0.05, 4);
  return std::move(sheet).Take();
}

GrayImage PaintBooks(const Canvas& canvas, Rng& rng) {
  constexpr double kBoard_m = 0.025;
  Sheet sheet(canvas, 30, rng);
  for (double shelf_m = 0; shelf_m < canvas.height_m;) {
    const double clear_m = rng.Uniform(0.26, 0.36);
    const double floor_m = shelf_m + kBoard_m + clear_m;
    sheet.Rectangle(0, shelf_m, canvas.width_m, kBoard_m, 150);
    for (double x_m = rng.Uniform(0, 0.05); x_m < canvas.width_m;) {
      const double thick_m = rng.Uniform(0.02, 0.07);
      const double tall_m = clear_m * rng.Uniform(0.6, 0.95);
      const double level = rng.Uniform(40, 230);
      const double ink = level < 130 ? level + 90 : level - 90;
      sheet.Rectangle(x_m, floor_m - tall_m, thick_m - 0.003, tall_m, level);
      for (auto bands = 1 + rng.Below(3); bands > 0; --bands) {
        sheet.Rectangle(x_m, floor_m - tall_m * rng.Uniform(0.1, 0.95), thick_m - 0.003, rng.Uniform(0.005, 0.03), ink);
      }
      sheet.Text(x_m + 0.003, floor_m - tall_m * rng.Uniform(0.4, 0.8), thick_m, 0.6 * thick_m, ink);
      x_m += rng.Uniform() < 0.08 ? thick_m + rng.Uniform(0.03, 0.1) : thick_m;
    }
    shelf_m = floor_m;
  }
  sheet.Grain(0.05, 5);
  return std::move(sheet).Take();
}

GrayImage PaintRug(const Canvas& canvas, Rng& rng) {
  Sheet sheet(canvas, 50, rng);
  sheet.Rectangle(0.06, 0.06, canvas.width_m - 0.12, canvas.height_m - 0.12, 120);
  const auto num_patches = static_cast<int>(90 * canvas.width_m * canvas.height_m);
  for (int i = 0; i < num_patches; ++i) {
    sheet.Patch(rng.Uniform(0.1, canvas.width_m - 0.1), rng.Uniform(0.1, canvas.height_m - 0.1),
                rng.Uniform(0.02, 0.12), rng.Uniform(40, 220));
  }
  sheet.Grain(0.1, 7);
  return std::move(sheet).Take();
}

GrayImage PaintCarton(const Canvas& canvas, Rng& rng) {
  const double w = canvas.width_m;
  const double h = canvas.height_m;
  Sheet sheet(canvas, rng.Uniform(100, 160), rng);
  sheet.Stains(250, 45);
  sheet.Rectangle(0, rng.Uniform(0.2, 0.7) * h, w, 0.05, rng.Uniform(170, 210));
  sheet.Text(0.08 * w, rng.Uniform(0.05, 0.2) * h, 0.7 * w, std::min(0.1 * h, 0.08), 35);
  const double label_x_m = rng.Uniform(0.1, 0.5) * w;
  const double label_y_m = rng.Uniform(0.35, 0.55) * h;
  sheet.Rectangle(label_x_m, label_y_m, 0.42 * w, 0.35 * h, 235);
  sheet.Paragraph(label_x_m + 0.03 * w, label_y_m + 0.04 * h, 0.36 * w, 0.3 * h, std::max(0.035 * h, 0.008), 25);
  sheet.Drawing(rng.Uniform(0.05, 0.5) * w, 0.7 * h, 0.4 * w, 0.28 * h);
  sheet.Line(0, 0, w, 0, 0.01, 40);
  sheet.Line(0, 0, 0, h, 0.01, 40);
  sheet.Grain(0.1, 7);
  return std::move(sheet).Take();
}

}  // namespace mapp::sim
