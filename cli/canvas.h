#pragma once

#include "mapp/base/status.h"

#include <Eigen/Core>

#include <cstdint>
#include <memory>
#include <string>
#include <vector>

namespace mapp {

struct Color {
  uint8_t red = 0;
  uint8_t green = 0;
  uint8_t blue = 0;
};
inline constexpr Color kWhite{255, 255, 255};
/// The color mixed with white, for areas under lines of that color.
Color Tint(Color color);

/// A white picture to draw on with smooth edges. Positions in pixels, (0, 0) at the centre of the top left one; what
/// lies outside is cut off. One thread only.
class Canvas {
 public:
  Canvas(int width_px, int height_px);
  ~Canvas();

  void Line(const Eigen::Vector2d& from, const Eigen::Vector2d& to, int thickness_px, Color color);
  void Circle(const Eigen::Vector2d& center, int radius_px, int thickness_px, Color color);
  void Disc(const Eigen::Vector2d& center, int radius_px, Color fill, Color edge);
  void Diamond(const Eigen::Vector2d& center, int radius_px, Color fill);
  /// The outline through the corners and back to the first.
  void Polygon(const std::vector<Eigen::Vector2d>& corners, int thickness_px, Color color);
  void Arrow(const Eigen::Vector2d& from, const Eigen::Vector2d& to, int thickness_px, Color color);
  void FillSquare(const Eigen::Vector2d& center, int size_px, Color color);
  void FillRectangle(int left_px, int top_px, int width_px, int height_px, Color color);
  /// `left_baseline`: where the text begins. Characters beyond ASCII are shown as '?'.
  void Text(const Eigen::Vector2d& left_baseline, const std::string& text, double scale, Color color);
  /// Width and height of the text above its baseline, pixels.
  static Eigen::Vector2d TextSize(const std::string& text, double scale);

  StatusOr<std::string> EncodePng() const;

 private:
  struct Impl;
  std::unique_ptr<Impl> impl_;
};

}  // namespace mapp
