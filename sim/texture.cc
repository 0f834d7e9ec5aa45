#include "sim/texture.h"

#include "mapp/base/check.h"

#include <algorithm>
#include <bit>
#include <cstdint>
#include <utility>

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

/// log2, linear between powers of two: at most 0.09 off, unseen in a blend of mip levels. x > 0.
float FastLog2(float x) {
  const auto bits = std::bit_cast<uint32_t>(x);
  const float mantissa = std::bit_cast<float>((bits & 0x007fffffU) | 0x3f800000U);
  return static_cast<float>(static_cast<int>(bits >> 23) - 128) + mantissa;
}

float Bilinear(const GrayImage& image, float u, float v) {
  const float x = std::clamp(u * static_cast<float>(image.width) - 0.5F, 0.0F, static_cast<float>(image.width - 1));
  const float y = std::clamp(v * static_cast<float>(image.height) - 0.5F, 0.0F, static_cast<float>(image.height - 1));
  const int x0 = static_cast<int>(x);
  const int y0 = static_cast<int>(y);
  const int x1 = std::min(x0 + 1, image.width - 1);
  const int y1 = std::min(y0 + 1, image.height - 1);
  const float wx = x - static_cast<float>(x0);
  const float wy = y - static_cast<float>(y0);
  const float top = static_cast<float>(image.at(x0, y0)) * (1 - wx) + static_cast<float>(image.at(x1, y0)) * wx;
  const float bottom = static_cast<float>(image.at(x0, y1)) * (1 - wx) + static_cast<float>(image.at(x1, y1)) * wx;
  return top * (1 - wy) + bottom * wy;
}

}  // namespace

Texture::Texture(GrayImage image) {
  MAPP_CHECK(!image.empty());
  levels_.push_back(std::move(image));
  while (levels_.back().width > 1 || levels_.back().height > 1) levels_.push_back(Halve(levels_.back()));
}

float Texture::Sample(float u, float v, float footprint_texels) const {
  const float last = static_cast<float>(levels_.size() - 1);
  const float level = std::clamp(FastLog2(std::max(footprint_texels, 1.0F)), 0.0F, last);
  const auto fine = static_cast<size_t>(level);
  const float blend = level - static_cast<float>(fine);
  const float fine_value = Bilinear(levels_[fine], u, v);
  if (blend <= 0) return fine_value;
  return fine_value * (1 - blend) + Bilinear(levels_[fine + 1], u, v) * blend;
}

}  // namespace mapp::sim
