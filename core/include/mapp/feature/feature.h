#pragma once

#include <array>
#include <bit>
#include <cstdint>
#include <cstring>
#include <string_view>

namespace mapp {

/// 256-bit binary descriptor of an oriented FAST corner (ORB, Rublee et al. 2011), bytes in OpenCV's order.
struct OrbDescriptor {
  static constexpr int kBytes = 32;
  std::array<uint64_t, 4> words{};

  static OrbDescriptor FromBytes(const uint8_t* bytes) {
    OrbDescriptor descriptor;
    std::memcpy(descriptor.words.data(), bytes, kBytes);
    return descriptor;
  }
  std::string_view Bytes() const { return {reinterpret_cast<const char*>(words.data()), kBytes}; }
  friend bool operator==(const OrbDescriptor&, const OrbDescriptor&) = default;
};

/// Number of differing bits, 0 to 256.
inline int HammingDistance(const OrbDescriptor& a, const OrbDescriptor& b) {
  int distance = 0;
  for (int i = 0; i < 4; ++i) distance += std::popcount(a.words[i] ^ b.words[i]);
  return distance;
}

/// Corner in an image. `u_px, v_px` are pixels of the full-size image as the camera recorded it (distorted).
struct Keypoint {
  float u_px = 0;
  float v_px = 0;
  /// Orientation, radians in [0, 2 pi), clockwise in the image.
  float angle = 0;
  /// Pyramid level, 0 = full size; its scale is kPyramidScale ^ octave.
  uint8_t octave = 0;
};

struct Feature {
  Keypoint keypoint;
  OrbDescriptor descriptor;
};

/// Pyramid of the built-in extractor. Every map has this scale; how many levels, its FeatureSettings say.
inline constexpr float kPyramidScale = 1.2F;
inline constexpr int kPyramidLevels = 8;
/// n_f: a keyframe has at most this many features (DESIGN 2).
inline constexpr int kMaxFeatures = 1000;

/// kPyramidScale ^ octave.
float OctaveScale(int octave);

}  // namespace mapp
