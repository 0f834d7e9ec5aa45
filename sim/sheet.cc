#include "sim/sheet.h"

#include <opencv2/imgproc.hpp>

#include <algorithm>
#include <cmath>
#include <numbers>
#include <vector>

namespace mapp::sim {
namespace {

/// A view of the image, for OpenCV to draw into.
cv::Mat Wrap(GrayImage& image) { return {image.height, image.width, CV_8UC1, image.pixels.data()}; }

int RoundTexels(double length_m, double texels_per_m) { return static_cast<int>(std::lround(length_m * texels_per_m)); }

}  // namespace

Sheet::Sheet(const Canvas& canvas, double level, Rng& rng)
    : canvas_(canvas),
      rng_(rng),
      image_(std::max(RoundTexels(canvas.width_m, canvas.texels_per_m), 4),
             std::max(RoundTexels(canvas.height_m, canvas.texels_per_m), 4), cv::saturate_cast<uint8_t>(level)) {}

int Sheet::Texels(double length_m) const { return RoundTexels(length_m, canvas_.texels_per_m); }

void Sheet::Rectangle(double x_m, double y_m, double width_m, double height_m, double level) {
  const cv::Point corner(Texels(x_m), Texels(y_m));
  const cv::Point opposite(Texels(x_m + width_m) - 1, Texels(y_m + height_m) - 1);
  if (opposite.x >= corner.x && opposite.y >= corner.y) {
    cv::rectangle(Wrap(image_), corner, opposite, level, cv::FILLED);
  }
}

void Sheet::Disc(double x_m, double y_m, double radius_m, double level) {
  cv::circle(Wrap(image_), {Texels(x_m), Texels(y_m)}, std::max(Texels(radius_m), 1), level, cv::FILLED, cv::LINE_AA);
}

void Sheet::Line(double x0_m, double y0_m, double x1_m, double y1_m, double width_m, double level) {
  cv::line(Wrap(image_), {Texels(x0_m), Texels(y0_m)}, {Texels(x1_m), Texels(y1_m)}, level,
           std::max(Texels(width_m), 1), cv::LINE_AA);
}

void Sheet::Triangle(double x0_m, double y0_m, double x1_m, double y1_m, double x2_m, double y2_m, double level) {
  const std::vector<cv::Point> outline = {
      {Texels(x0_m), Texels(y0_m)}, {Texels(x1_m), Texels(y1_m)}, {Texels(x2_m), Texels(y2_m)}};
  cv::Mat mat = Wrap(image_);
  cv::fillPoly(mat, std::vector<std::vector<cv::Point>>{outline}, level, cv::LINE_AA);
}

void Sheet::Patch(double x_m, double y_m, double radius_m, double level) {
  std::vector<cv::Point> outline;
  const auto num_corners = static_cast<int>(3 + rng_.Below(5));
  const double turn = rng_.Uniform(0, 2 * std::numbers::pi);
  for (int i = 0; i < num_corners; ++i) {
    const double angle = turn + 2 * std::numbers::pi * (i + rng_.Uniform(0, 0.7)) / num_corners;
    const double distance_m = radius_m * rng_.Uniform(0.5, 1.0);
    outline.emplace_back(Texels(x_m + distance_m * std::cos(angle)), Texels(y_m + distance_m * std::sin(angle)));
  }
  cv::Mat mat = Wrap(image_);
  cv::fillPoly(mat, std::vector<std::vector<cv::Point>>{outline}, level, cv::LINE_AA);
}

void Sheet::Print(const std::string& text, double x_m, double y_m, double height_m, double level) {
  constexpr int kFontHeight = 21;  // of OpenCV's simplex capitals at scale 1, texels
  const double scale = height_m * canvas_.texels_per_m / kFontHeight;
  cv::putText(Wrap(image_), text, {Texels(x_m), Texels(y_m + height_m)}, cv::FONT_HERSHEY_SIMPLEX, scale, level,
              std::max(static_cast<int>(std::lround(2.2 * scale)), 1), cv::LINE_AA);
}

void Sheet::Text(double x_m, double y_m, double width_m, double height_m, double level) {
  static constexpr char kGlyphs[] = "ABCDEFGHIJKLMNOPQRSTUVWXYZ0123456789  ";
  const auto num_glyphs = static_cast<size_t>(std::max(width_m / (0.95 * height_m), 1.0));
  std::string text;
  while (text.size() < num_glyphs) text += kGlyphs[rng_.Below(sizeof(kGlyphs) - 1)];
  Print(text, x_m, y_m, height_m, level);
}

void Sheet::Paragraph(double x_m, double y_m, double width_m, double height_m, double glyph_m, double level) {
  for (double line_m = 0; line_m + glyph_m < height_m; line_m += 1.8 * glyph_m) {
    Text(x_m, y_m + line_m, width_m * rng_.Uniform(0.6, 1.0), glyph_m, level);
  }
}

void Sheet::Drawing(double x_m, double y_m, double width_m, double height_m) {
  const double edge_m = std::min(width_m, height_m);
  for (int i = 0; i < 14; ++i) {
    const double radius_m = edge_m * rng_.Uniform(0.03, 0.22);
    const double at_x_m = x_m + rng_.Uniform(radius_m, std::max(width_m - radius_m, radius_m));
    const double at_y_m = y_m + rng_.Uniform(radius_m, std::max(height_m - radius_m, radius_m));
    const double level = rng_.Uniform(20, 235);
    if (rng_.Uniform() < 0.4) {
      Disc(at_x_m, at_y_m, radius_m, level);
    } else {
      Patch(at_x_m, at_y_m, radius_m, level);
    }
    if (rng_.Uniform() < 0.4) {
      Line(at_x_m, at_y_m, x_m + rng_.Uniform(0, width_m), y_m + rng_.Uniform(0, height_m), 0.01 * edge_m,
           rng_.Uniform(20, 235));
    }
  }
}

void Sheet::Stains(double per_m2, double contrast) {
  constexpr double kSmallest_m = 0.004;
  constexpr double kLargest_m = 0.25;
  const double ratio2 = (kSmallest_m / kLargest_m) * (kSmallest_m / kLargest_m);
  for (auto left = std::llround(per_m2 * width_m() * height_m()); left > 0; --left) {
    const double radius_m = kSmallest_m / std::sqrt(1.0 - rng_.Uniform() * (1.0 - ratio2));
    const double x_m = rng_.Uniform(0, width_m());
    const double y_m = rng_.Uniform(0, height_m());
    const double here = image_.at(std::min(Texels(x_m), image_.width - 1), std::min(Texels(y_m), image_.height - 1));
    const double sign = rng_.Uniform() < 0.5 ? -1.0 : 1.0;
    Patch(x_m, y_m, radius_m, std::clamp(here + sign * contrast * rng_.Uniform(0.4, 1.0), 5.0, 250.0));
  }
}

void Sheet::Grain(double coarsest_m, double amplitude) {
  cv::Mat mat = Wrap(image_);
  double cell = std::max(coarsest_m * canvas_.texels_per_m, 1.0);
  for (; cell >= 1.0; cell /= 2.0, amplitude *= 0.75) {
    cv::Mat coarse(static_cast<int>(mat.rows / cell) + 2, static_cast<int>(mat.cols / cell) + 2, CV_32FC1);
    for (int row = 0; row < coarse.rows; ++row) {
      std::generate_n(coarse.ptr<float>(row), coarse.cols,
                      [&] { return static_cast<float>(rng_.Uniform(-amplitude, amplitude)); });
    }
    cv::Mat fine;
    cv::resize(coarse, fine, mat.size(), 0, 0, cv::INTER_LINEAR);
    cv::add(mat, fine, mat, cv::noArray(), CV_8U);
  }
}

}  // namespace mapp::sim
