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
constexpr float kAlone = 0.3F;

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
    : width(image.width), height(image.height), strip_bytes(kRowBytes * (height + 2)) {
  const int num_strips = width / kStripWidth + 1;
  // The last texels are read together with what follows them.
  constexpr size_t kPadding = 4;
  texels.reserve(static_cast<size_t>(num_strips) * static_cast<size_t>(strip_bytes) + kPadding);
  for (int strip = 0; strip < num_strips; ++strip) {
    for (int y = 0; y <= height + 1; ++y) {
      for (int i = 0; i < kRowBytes; ++i) texels.push_back(image.at((strip * kStripWidth + i) % width, y % height));
    }
  }
  texels.resize(texels.size() + kPadding);
}

float Texture::Sample(float u, float v, float footprint_texels) const {
  return SampleLevel(Eigen::Array4f::Constant(u), Eigen::Array4f::Constant(v),
                     FastLog2(std::max(footprint_texels, 1.0F)), Beyond::kClamp)[0];
}

Texture::Slice Texture::AtLevel(float level, Beyond beyond) const {
  const float clamped = std::clamp(level, 0.0F, static_cast<float>(levels_.size() - 1));
  const auto fine = static_cast<size_t>(clamped);
  const float blend = (clamped - static_cast<float>(fine) - kAlone) / (1 - 2 * kAlone);
  if (blend >= 1) return Slice(levels_[fine + 1], beyond);
  Slice slice(levels_[fine], beyond);
  if (blend > 0) {
    slice.coarse_ = &levels_[fine + 1];
    slice.blend_ = blend;
  }
  return slice;
}

Eigen::Array4f Texture::SampleLevel(const Eigen::Array4f& u, const Eigen::Array4f& v, float level,
                                    Beyond beyond) const {
  return AtLevel(level, beyond).At(u, v);
}

}  // namespace mapp::sim
