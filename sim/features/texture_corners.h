#pragma once

#include "mapp/feature/feature.h"
#include "mapp/image/image.h"

#include <cstddef>
#include <span>
#include <vector>

namespace mapp::sim {

/// A corner of a picture, as ORB finds and describes it at one size.
struct TextureCorner {
  float x_texels = 0;  ///< from the picture's outer left edge
  float y_texels = 0;  ///< from its outer upper edge
  float angle = 0;     ///< orientation in the picture, radians, clockwise
  float response = 0;  ///< FAST score: the contrast, in gray levels, up to which it is a corner
  OrbDescriptor descriptor;
};

/// The corners of a picture at one size, in square cells.
struct CornerLevel {
  double pitch_texels = 1;  ///< edge of the pixels at which these are corners: kPyramidScale^level texels
  double cell_texels = 1;
  int columns = 0;
  int rows = 0;
  std::vector<size_t> cell_start;      ///< columns * rows + 1, row-major
  std::vector<TextureCorner> corners;  ///< of each cell the strongest, strongest first

  std::span<const TextureCorner> Cell(int column, int row) const;
};

/// What ORB finds in a picture seen from straight ahead, at each step of the feature pyramid from one texel a pixel
/// down to a few pixels for all of it. A camera whose pixels (of some octave) are about as large as a level's sees that
/// level's corners. The picture is taken to repeat beyond its borders, as textures do. Immutable, thread-safe.
class TextureCorners {
 public:
  /// Of a cell of 64 x 64 pixels only so many can ever be among the 1000 features of an image.
  static constexpr int kMaxPerCell = 15;

  /// `picture` must not be empty. Takes about 0.1 s for 2000 x 1000 texels.
  explicit TextureCorners(const GrayImage& picture);

  int width_texels() const { return width_texels_; }
  int height_texels() const { return height_texels_; }
  /// Level k belongs to pixels of kPyramidScale^k texels.
  const std::vector<CornerLevel>& levels() const { return levels_; }

 private:
  int width_texels_;
  int height_texels_;
  std::vector<CornerLevel> levels_;
};

}  // namespace mapp::sim
