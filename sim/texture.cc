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
    : width(image.width), height(image.height), stride(static_cast<size_t>(image.width) + 2) {
  texels.reserve(stride * (static_cast<size_t>(height) + 2));
  for (int y = 0; y <= height + 1; ++y) {
    for (int x = 0; x <= width + 1; ++x) texels.push_back(image.at(x % width, y % height));
  }
}

/// Blends between the texels whose centres stand at whole numbers.
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
    x = (x < 0.0F).select(x + size_x, x);
    y = (y < 0.0F).select(y + size_y, y);
  }
  const Eigen::Array4i x0 = x.cast<int>();
  const Eigen::Array4i y0 = y.cast<int>();
  // Two neighbours at once: the right one in the upper byte.
  Eigen::Array4i top_pair, bottom_pair;
  for (int i = 0; i < 4; ++i) {
    const uint8_t* top = texels.data() + static_cast<size_t>(y0[i]) * stride + static_cast<size_t>(x0[i]);
    const uint8_t* bottom = top + stride;
    top_pair[i] = top[0] | top[1] << 8;
    bottom_pair[i] = bottom[0] | bottom[1] << 8;
  }
  const Eigen::Array4i top_right = top_pair.shiftRight<8>();
  const Eigen::Array4i bottom_right = bottom_pair.shiftRight<8>();
  const Eigen::Array4i top_left = top_pair - top_right.shiftLeft<8>();
  const Eigen::Array4i bottom_left = bottom_pair - bottom_right.shiftLeft<8>();
  const Eigen::Array4f wx = x - x0.cast<float>();
  const Eigen::Array4f wy = y - y0.cast<float>();
  const Eigen::Array4f above = top_left.cast<float>() + (top_right - top_left).cast<float>() * wx;
  const Eigen::Array4f below = bottom_left.cast<float>() + (bottom_right - bottom_left).cast<float>() * wx;
  return above + (below - above) * wy;
}

float Texture::Sample(float u, float v, float footprint_texels) const {
  return SampleLevel(Eigen::Array4f::Constant(u), Eigen::Array4f::Constant(v),
                     FastLog2(std::max(footprint_texels, 1.0F)), Beyond::kClamp)[0];
}

Eigen::Array4f Texture::SampleLevel(const Eigen::Array4f& u_any, const Eigen::Array4f& v_any, float level,
                                    Beyond beyond) const {
  Eigen::Array4f u = u_any;
  Eigen::Array4f v = v_any;
  if (beyond == Beyond::kRepeat) {
    u -= u.floor();
    v -= v.floor();
  }
  const float clamped = std::clamp(level, 0.0F, static_cast<float>(levels_.size() - 1));
  const auto fine = static_cast<size_t>(clamped);
  const float blend = (clamped - static_cast<float>(fine) - kAlone) / (1 - 2 * kAlone);
  if (blend <= 0) return levels_[fine].At(u, v, beyond);
  if (blend >= 1) return levels_[fine + 1].At(u, v, beyond);
  const Eigen::Array4f fine_value = levels_[fine].At(u, v, beyond);
  return fine_value + (levels_[fine + 1].At(u, v, beyond) - fine_value) * blend;
}

}  // namespace mapp::sim
