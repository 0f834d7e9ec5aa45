#pragma once

#include "mapp/feature/feature.h"
#include "sim/texture.h"

#include <array>
#include <cstdint>
#include <memory>
#include <mutex>
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

/// A picture as surfaces show it: a texture, perhaps mirrored, with square texels.
struct TexturePicture {
  std::shared_ptr<const Texture> texture;  ///< never null
  bool flip_u = false;
  double log_aspect = 0;  ///< of a texel's width to its height on the surface
};

/// The corners of a picture at one size, in square cells. Found block by block when first asked for, always the same.
/// Thread-safe.
class CornerLevel {
 public:
  /// Of a cell of 64 x 64 pixels only so many can ever be among the 1000 features of an image.
  static constexpr int kMaxPerCell = 15;

  /// A pixel is `pitch_texels` wide and `width_px` x `height_px` of them are the picture.
  CornerLevel(const TexturePicture& picture, double pitch_texels, int width_px, int height_px);

  double pitch_texels() const { return pitch_texels_; }
  double cell_texels() const;
  int columns() const { return columns_; }
  int rows() const { return rows_; }
  /// Of the cell the strongest corners, strongest first. Takes a few milliseconds for the first cell of a block.
  std::span<const TextureCorner> Cell(int column, int row) const;

 private:
  static constexpr int kBlockCells = 4;  ///< along an edge
  struct Block {
    std::once_flag once;
    std::vector<TextureCorner> corners;
    std::array<uint32_t, kBlockCells * kBlockCells + 1> cell_start{};
  };

  void Fill(int block_column, int block_row, Block& block) const;

  TexturePicture picture_;
  double pitch_texels_;
  int width_px_, height_px_;
  int columns_, rows_;
  int block_columns_;
  std::unique_ptr<Block[]> blocks_;
};

/// What ORB finds in a picture seen from straight ahead, at each step of the feature pyramid from one texel a pixel
/// down to a few pixels for all of it. A camera whose pixels (of some octave) are about as large as a level's sees that
/// level's corners. The picture is taken to repeat beyond its borders, as textures do. Thread-safe.
class TextureCorners {
 public:
  explicit TextureCorners(const TexturePicture& picture);

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
