#pragma once

#include "cli/canvas.h"

#include <Eigen/Core>

#include <cstddef>
#include <functional>
#include <string>

namespace mapp {

inline constexpr Color kInk{30, 30, 30};
inline constexpr Color kPale{120, 120, 120};
inline constexpr Color kPanel{246, 246, 246};
inline constexpr int kLegendWidthPx = 300;
inline constexpr int kLegendMarginPx = 20;

/// The color of the trajectory with that number.
Color TrackColor(size_t track_idx);

/// The legend's pen: writes line after line.
class Legend {
 public:
  Legend(Canvas& canvas, int left_px, int top_px) : canvas_(canvas), left_px_(left_px), y_px_(top_px) {}

  void Title(const std::string& text) { Line(text, 0.62, kInk, 0); }
  void Note(const std::string& text) { Line(text, 0.45, kPale, 0); }
  void Gap() { y_px_ += 14; }
  /// A line of text behind a symbol, which `draw` puts around the pixel it is given.
  void Entry(const std::string& text, const std::function<void(const Eigen::Vector2d&)>& draw);
  int y_px() const { return y_px_; }

 private:
  void Line(const std::string& text, double scale, Color color, int indent_px);

  Canvas& canvas_;
  int left_px_;
  int y_px_;
};

/// A bar of a round length with its length above, as wide as the legend at most.
void DrawScaleBar(double pixels_per_m, int left_px, int bottom_px, Canvas& canvas);

}  // namespace mapp
