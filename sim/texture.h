#pragma once

#include "mapp/image/image.h"

#include <vector>

namespace mapp::sim {

/// A gray picture with its mip levels, each half the size of the one before. Immutable, thread-safe.
class Texture {
 public:
  /// `image` must not be empty.
  explicit Texture(GrayImage image);

  int width() const { return levels_.front().width; }
  int height() const { return levels_.front().height; }

  /// Gray level at (u, v) in [0, 1]^2, (0, 0) being the outer corner of the first texel; blends linearly between texels
  /// and between mip levels. `footprint_texels` is the edge of what one sample covers, in texels of level 0.
  float Sample(float u, float v, float footprint_texels) const;

 private:
  std::vector<GrayImage> levels_;
};

}  // namespace mapp::sim
