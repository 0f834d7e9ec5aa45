#pragma once

#include "mapp/image/image.h"
#include "sim/four.h"

#include <Eigen/Core>

#include <bit>
#include <cstddef>
#include <cstdint>
#include <cstring>
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
  class Slice;
  /// The picture at a mip level, 0 being the finest; fractions blend, and a level out of range is the nearest one.
  Slice AtLevel(float level, Beyond beyond) const;
  Eigen::Array4f SampleLevel(const Eigen::Array4f& u, const Eigen::Array4f& v, float level, Beyond beyond) const;

  /// log2, linear between powers of two: at most 0.09 off, unseen in a blend of mip levels. x > 0.
  static float FastLog2(float x) {
    const auto bits = std::bit_cast<uint32_t>(x);
    const float mantissa = std::bit_cast<float>((bits & 0x007fffffU) | 0x3f800000U);
    return static_cast<float>(static_cast<int>(bits >> 23) - 128) + mantissa;
  }

 private:
  /// A picture cut into upright strips, which are stored one after the other, so that texels near each other in any
  /// direction share a cache line. Rows and columns are followed by the first two again, and each row of a strip by the
  /// first texel of the next, so that every position up to the picture's size has its right and lower neighbours in its
  /// strip.
  struct Level {
    static constexpr int kStripShift = 2;
    static constexpr int kStripWidth = 1 << kStripShift;
    static constexpr int kRowBytes = kStripWidth + 1;

    explicit Level(const GrayImage& image);
    Eigen::Array4f At(const Eigen::Array4f& u, const Eigen::Array4f& v, Beyond beyond) const;

    int width = 0;
    int height = 0;
    int strip_bytes = 0;
    std::vector<uint8_t> texels;
  };

  std::vector<Level> levels_;
};

/// A texture at one mip level. The texture must outlive it.
class Texture::Slice {
 public:
  /// Gray levels at four places.
  Eigen::Array4f At(const Eigen::Array4f& u, const Eigen::Array4f& v) const {
    if (beyond_ == Beyond::kClamp) return Blend(u, v);
    return Blend(u - u.floor(), v - v.floor());
  }

 private:
  friend class Texture;
  Slice(const Level& level, Beyond beyond) : fine_(&level), beyond_(beyond) {}

  Eigen::Array4f Blend(const Eigen::Array4f& u, const Eigen::Array4f& v) const {
    const Eigen::Array4f fine = fine_->At(u, v, beyond_);
    if (coarse_ == nullptr) return fine;
    return fine + (coarse_->At(u, v, beyond_) - fine) * blend_;
  }

  const Level* fine_;
  const Level* coarse_ = nullptr;  ///< null: the fine one alone
  float blend_ = 0;
  Beyond beyond_;
};

/// Blends between the texels whose centres stand at whole numbers. Inline, as drawing does little else.
inline Eigen::Array4f Texture::Level::At(const Eigen::Array4f& u, const Eigen::Array4f& v, Beyond beyond) const {
  const auto size_x = static_cast<float>(width);
  const auto size_y = static_cast<float>(height);
  Eigen::Array4f x = u * size_x - 0.5F;
  Eigen::Array4f y = v * size_y - 0.5F;
  if (beyond == Beyond::kClamp) {
    x = x.max(0.0F).min(size_x - 1);
    y = y.max(0.0F).min(size_y - 1);
  } else {
    // u and v are in [0, 1], so the position is in [-0.5, size - 0.5], and in [0, size] when moved.
    x += Masked(AreGreater(Eigen::Array4f::Zero(), x), Eigen::Array4f::Constant(size_x));
    y += Masked(AreGreater(Eigen::Array4f::Zero(), y), Eigen::Array4f::Constant(size_y));
  }
  const Int4 x0 = Truncate(x);
  const Int4 y0 = Truncate(y);
  const Int4 offsets = (x0 >> kStripShift) * strip_bytes + (x0 & (kStripWidth - 1)) + y0 * kRowBytes;
  // Two neighbours at once, the left one in the lowest byte; what else is read with them is masked.
  Int4 top, bottom;
  for (int i = 0; i < 4; ++i) {
    const uint8_t* texel = texels.data() + offsets[i];
    int32_t pair;
    std::memcpy(&pair, texel, sizeof(pair));
    top[i] = pair;
    std::memcpy(&pair, texel + kRowBytes, sizeof(pair));
    bottom[i] = pair;
  }
  const Eigen::Array4f top_left = ToFloat(top & 0xff);
  const Eigen::Array4f bottom_left = ToFloat(bottom & 0xff);
  const Eigen::Array4f wx = x - ToFloat(x0);
  const Eigen::Array4f wy = y - ToFloat(y0);
  const Eigen::Array4f above = top_left + (ToFloat(top >> 8 & 0xff) - top_left) * wx;
  const Eigen::Array4f below = bottom_left + (ToFloat(bottom >> 8 & 0xff) - bottom_left) * wx;
  return above + (below - above) * wy;
}

}  // namespace mapp::sim
