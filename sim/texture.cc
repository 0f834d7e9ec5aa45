#include "sim/texture.h"

#include "mapp/base/check.h"

#include <algorithm>
#include <cmath>
#include <cstdint>

namespace mapp::sim {
namespace {

/// The mean of each 2 x 2 block; an odd last row or column counts twice.
GrayImage Halve(const GrayImage& image) {
  GrayImage half(std::max(image.width / 2, 1), std::max(image.height / 2, 1));
  for (int y = 0; y < half.height; ++y) {
    const int y0 = std::min(2 * y, image.height - 1);
    const int y1 = std::min(2 * y + 1, image.height - 1);
    for (int x = 0; x < half.width; ++x) {
      const int x0 = std::min(2 * x, image.width - 1);
      const int x1 = std::min(2 * x + 1, image.width - 1);
      const int sum = image.at(x0, y0) + image.at(x1, y0) + image.at(x0, y1) + image.at(x1, y1);
      half.at(x, y) = static_cast<uint8_t>((sum + 2) / 4);
    }
  }
  return half;
}

/// A mip level is shown alone this far, in levels, to either side of it; in between two of them are blended. (Blending
/// over the whole way would look twice as often, for a difference that cannot be seen.)
constexpr float kAlone = 0.2F;

}  // namespace

Texture::Texture(GrayImage image) {
  MAPP_CHECK(!image.empty());
  levels_.emplace_back(image);
  while (image.width > 1 || image.height > 1) {
    image = Halve(image);
    levels_.emplace_back(image);
  }
}

Texture::Level::Level(const GrayImage& image)
    : width(image.width), height(image.height), stride(static_cast<size_t>(image.width) + 2) {
  texels.reserve(stride * (static_cast<size_t>(height) + 2));
  for (int y = 0; y <= height + 1; ++y) {
    for (int x = 0; x <= width + 1; ++x) texels.push_back(image.at(x % width, y % height));
  }
}

/// Between the texels whose centres stand at whole numbers; x in [0, width], y in [0, height].
inline float Texture::Level::Blend(float x, float y) const {
  const int x0 = static_cast<int>(x);
  const int y0 = static_cast<int>(y);
  const float wx = x - static_cast<float>(x0);
  const float wy = y - static_cast<float>(y0);
  const uint8_t* top = texels.data() + static_cast<size_t>(y0) * stride + static_cast<size_t>(x0);
  const uint8_t* bottom = top + stride;
  const auto above = static_cast<float>(top[0]) + static_cast<float>(top[1] - top[0]) * wx;
  const auto below = static_cast<float>(bottom[0]) + static_cast<float>(bottom[1] - bottom[0]) * wx;
  return above + (below - above) * wy;
}

inline float Texture::Level::At(float u, float v, Beyond beyond) const {
  const auto size_x = static_cast<float>(width);
  const auto size_y = static_cast<float>(height);
  float x = u * size_x - 0.5F;
  float y = v * size_y - 0.5F;
  if (beyond == Beyond::kClamp) {
    x = std::clamp(x, 0.0F, size_x - 1);
    y = std::clamp(y, 0.0F, size_y - 1);
  } else {
    // u and v are in [0, 1], so the position is in [-0.5, size - 0.5], and in [0, size] when moved.
    if (x < 0) x += size_x;
    if (y < 0) y += size_y;
  }
  return Blend(x, y);
}

float Texture::Sample(float u, float v, float footprint_texels) const {
  return SampleLevel(u, v, FastLog2(std::max(footprint_texels, 1.0F)), Beyond::kClamp);
}

float Texture::SampleLevel(float u, float v, float level, Beyond beyond) const {
  if (beyond == Beyond::kRepeat) {
    u -= std::floor(u);
    v -= std::floor(v);
  }
  const float clamped = std::clamp(level, 0.0F, static_cast<float>(levels_.size() - 1));
  const auto fine = static_cast<size_t>(clamped);
  const float blend = (clamped - static_cast<float>(fine) - kAlone) / (1 - 2 * kAlone);
  if (blend <= 0) return levels_[fine].At(u, v, beyond);
  if (blend >= 1) return levels_[fine + 1].At(u, v, beyond);
  const float fine_value = levels_[fine].At(u, v, beyond);
  return fine_value + (levels_[fine + 1].At(u, v, beyond) - fine_value) * blend;
}

}  // namespace mapp::sim
