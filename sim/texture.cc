#include "sim/texture.h"

#include "mapp/base/check.h"

#include <algorithm>
#include <cmath>
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

/// Two neighbouring texels along one axis, and how far the sample lies towards the second.
struct Neighbours {
  size_t first = 0;
  size_t second = 0;
  float weight = 0;
};

Neighbours Clamped(float coordinate, int size) {
  const float texel = std::clamp(coordinate * static_cast<float>(size) - 0.5F, 0.0F, static_cast<float>(size - 1));
  const int first = static_cast<int>(texel);
  return {static_cast<size_t>(first), static_cast<size_t>(std::min(first + 1, size - 1)),
          texel - static_cast<float>(first)};
}

Neighbours Repeated(float coordinate, int size) {
  const float shifted = (coordinate - std::floor(coordinate)) * static_cast<float>(size) + 0.5F;
  const int second = static_cast<int>(shifted);  // in [0, size]
  return {static_cast<size_t>(second == 0 ? size - 1 : second - 1), static_cast<size_t>(second < size ? second : 0),
          shifted - static_cast<float>(second)};
}

float Blend(const GrayImage& image, const Neighbours& x, const Neighbours& y) {
  const uint8_t* top = image.pixels.data() + y.first * static_cast<size_t>(image.width);
  const uint8_t* bottom = image.pixels.data() + y.second * static_cast<size_t>(image.width);
  const auto at = [](const uint8_t* row, size_t column) { return static_cast<float>(row[column]); };
  const float above = at(top, x.first) + (at(top, x.second) - at(top, x.first)) * x.weight;
  const float below = at(bottom, x.first) + (at(bottom, x.second) - at(bottom, x.first)) * x.weight;
  return above + (below - above) * y.weight;
}

float Bilinear(const GrayImage& image, float u, float v, Texture::Beyond beyond) {
  return beyond == Texture::Beyond::kClamp ? Blend(image, Clamped(u, image.width), Clamped(v, image.height))
                                           : Blend(image, Repeated(u, image.width), Repeated(v, image.height));
}

}  // namespace

Texture::Texture(GrayImage image) {
  MAPP_CHECK(!image.empty());
  levels_.push_back(std::move(image));
  while (levels_.back().width > 1 || levels_.back().height > 1) levels_.push_back(Halve(levels_.back()));
}

float Texture::Sample(float u, float v, float footprint_texels) const {
  return SampleLevel(u, v, FastLog2(std::max(footprint_texels, 1.0F)), Beyond::kClamp);
}

float Texture::SampleLevel(float u, float v, float level, Beyond beyond) const {
  const float clamped = std::clamp(level, 0.0F, static_cast<float>(levels_.size() - 1));
  const auto fine = static_cast<size_t>(clamped);
  const float blend = clamped - static_cast<float>(fine);
  const float fine_value = Bilinear(levels_[fine], u, v, beyond);
  if (blend <= 0) return fine_value;
  return fine_value + (Bilinear(levels_[fine + 1], u, v, beyond) - fine_value) * blend;
}

}  // namespace mapp::sim
