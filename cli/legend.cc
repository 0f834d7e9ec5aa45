#include "cli/legend.h"

#include <fmt/format.h>

#include <array>
#include <cmath>

namespace mapp {
namespace {

/// Colors that people of any color vision tell apart (Okabe and Ito, 2008).
constexpr std::array<Color, 6> kTrackColors = {
    {{0, 114, 178}, {213, 94, 0}, {0, 158, 115}, {204, 121, 167}, {230, 159, 0}, {86, 180, 233}}};

/// The longest of 1, 2, 5 times a power of ten that fits `max_px`, metres.
double ScaleBarLength(double pixels_per_m, double max_px) {
  const double max_m = max_px / pixels_per_m;
  const double decade = std::pow(10, std::floor(std::log10(max_m)));
  for (const double step : {5.0, 2.0}) {
    if (step * decade <= max_m) return step * decade;
  }
  return decade;
}

}  // namespace

Color TrackColor(size_t track_idx) { return kTrackColors[track_idx % kTrackColors.size()]; }

void Legend::Entry(const std::string& text, const std::function<void(const Eigen::Vector2d&)>& draw) {
  draw(Eigen::Vector2d(left_px_ + 12, y_px_ - 5));
  Line(text, 0.45, kInk, 34);
}

void Legend::Line(const std::string& text, double scale, Color color, int indent_px) {
  canvas_.Text(Eigen::Vector2d(left_px_ + indent_px, y_px_), text, scale, color);
  y_px_ += 24;
}

void DrawScaleBar(double pixels_per_m, int left_px, int bottom_px, Canvas& canvas) {
  const double length_m = ScaleBarLength(pixels_per_m, kLegendWidthPx - 2 * kLegendMarginPx);
  const Eigen::Vector2d left(left_px, bottom_px);
  const Eigen::Vector2d right(left_px + length_m * pixels_per_m, bottom_px);
  const Eigen::Vector2d tick(0, 6);
  canvas.Line(left, right, 2, kInk);
  canvas.Line(left - tick, left + tick, 2, kInk);
  canvas.Line(right - tick, right + tick, 2, kInk);
  canvas.Text(left + Eigen::Vector2d(4, -12), fmt::format("{} m", length_m), 0.5, kInk);
}

}  // namespace mapp
