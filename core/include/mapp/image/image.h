#pragma once

#include <cstddef>
#include <cstdint>
#include <vector>

namespace mapp {

/// Borrowed row-major image; `stride` in elements.
template <typename T>
struct ImageView {
  const T* data = nullptr;
  int width = 0;
  int height = 0;
  size_t stride = 0;

  bool empty() const { return data == nullptr || width <= 0 || height <= 0; }
  const T& at(int x, int y) const { return data[static_cast<size_t>(y) * stride + static_cast<size_t>(x)]; }
};

/// Owned row-major image without padding.
template <typename T>
struct Image {
  int width = 0;
  int height = 0;
  std::vector<T> pixels;

  Image() = default;
  Image(int w, int h, T fill = T{})
      : width(w), height(h), pixels(static_cast<size_t>(w) * static_cast<size_t>(h), fill) {}
  bool empty() const { return pixels.empty(); }
  T& at(int x, int y) { return pixels[static_cast<size_t>(y) * static_cast<size_t>(width) + static_cast<size_t>(x)]; }
  const T& at(int x, int y) const {
    return pixels[static_cast<size_t>(y) * static_cast<size_t>(width) + static_cast<size_t>(x)];
  }
  ImageView<T> View() const { return {pixels.data(), width, height, static_cast<size_t>(width)}; }
};

using GrayImage = Image<uint8_t>;
/// Depth along the optical axis, metres; 0 = no reading. Registered to the colour or left camera.
using DepthImage = Image<float>;

}  // namespace mapp
