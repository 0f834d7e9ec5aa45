#pragma once

#include "mapp/image/image.h"

#include <Eigen/Core>

#include <bit>
#include <cstddef>
#include <cstdint>
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

  /// What lies beyond [0, 1]: the border's texels, or the picture again.
  enum class Beyond : uint8_t { kClamp, kRepeat };
  /// Four samples at a mip level, 0 being the finest; fractions blend, and a level out of range is the nearest one.
  Eigen::Array4f SampleLevel(const Eigen::Array4f& u, const Eigen::Array4f& v, float level, Beyond beyond) const;

  /// log2, linear between powers of two: at most 0.09 off, unseen in a blend of mip levels. x > 0.
  static float FastLog2(float x) {
    const auto bits = std::bit_cast<uint32_t>(x);
    const float mantissa = std::bit_cast<float>((bits & 0x007fffffU) | 0x3f800000U);
    return static_cast<float>(static_cast<int>(bits >> 23) - 128) + mantissa;
  }

 private:
  /// A picture whose rows and columns are followed by the first two again, so that every position up to its size has a
  /// right and a lower neighbour.
  struct Level {
    explicit Level(const GrayImage& image);
    Eigen::Array4f At(const Eigen::Array4f& u, const Eigen::Array4f& v, Beyond beyond) const;

    int width = 0;
    int height = 0;
    size_t stride = 0;
    std::vector<uint8_t> texels;
  };

  std::vector<Level> levels_;
};

}  // namespace mapp::sim
