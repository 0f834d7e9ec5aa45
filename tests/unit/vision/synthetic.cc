#include "tests/unit/vision/synthetic.h"

#include <algorithm>
#include <cmath>

namespace mapp::test {
namespace {

double SquareLevel(int64_t column, int64_t row) {
  return 30.0 + 195.0 * Rng(static_cast<uint64_t>(column * 7919 + row)).Uniform();
}

/// 0 below the edge's ramp, 1 above: squares blend over a fifth of their width.
double Ramp(double fraction) { return std::clamp((fraction - 0.4) / 0.2, 0.0, 1.0); }

}  // namespace

double TextureAt(double x, double y) {
  const double column = std::floor(x);
  const double row = std::floor(y);
  const double u = Ramp(x - column);
  const double v = Ramp(y - row);
  const auto c = static_cast<int64_t>(column);
  const auto r = static_cast<int64_t>(row);
  return (1 - v) * ((1 - u) * SquareLevel(c, r) + u * SquareLevel(c + 1, r)) +
         v * ((1 - u) * SquareLevel(c, r + 1) + u * SquareLevel(c + 1, r + 1));
}

GrayImage TexturedImage(int width_px, int height_px, double square_px, int shift_x, int shift_y) {
  GrayImage image(width_px, height_px);
  for (int y = 0; y < height_px; ++y) {
    for (int x = 0; x < width_px; ++x) {
      image.at(x, y) =
          static_cast<uint8_t>(std::lround(TextureAt((x + shift_x) / square_px, (y + shift_y) / square_px)));
    }
  }
  return image;
}

OrbDescriptor RandomDescriptor(Rng& rng) {
  OrbDescriptor descriptor;
  for (uint64_t& word : descriptor.words) word = rng.Next();
  return descriptor;
}

OrbDescriptor FlipBits(OrbDescriptor descriptor, int num_flips, Rng& rng) {
  const OrbDescriptor original = descriptor;
  while (HammingDistance(original, descriptor) < num_flips) {
    const uint64_t bit = rng.Below(256);
    const uint64_t mask = uint64_t{1} << (bit % 64);
    descriptor.words[bit / 64] = (descriptor.words[bit / 64] & ~mask) | (~original.words[bit / 64] & mask);
  }
  return descriptor;
}

std::vector<OrbDescriptor> RandomDescriptors(size_t count, Rng& rng) {
  std::vector<OrbDescriptor> descriptors;
  for (size_t i = 0; i < count; ++i) descriptors.push_back(RandomDescriptor(rng));
  return descriptors;
}

Eigen::Vector3d RandomVector(double half_range, Rng& rng) {
  const double x = rng.Uniform(-half_range, half_range);
  const double y = rng.Uniform(-half_range, half_range);
  return {x, y, rng.Uniform(-half_range, half_range)};
}

Pose3 RandomPose(double max_angle, double max_offset_m, Rng& rng) {
  const Eigen::Vector3d axis = RandomVector(1.0, rng).normalized();
  const double angle = rng.Uniform(0, max_angle);
  return Pose3(ExpSo3(angle * axis), RandomVector(max_offset_m, rng));
}

Eigen::Vector3d RandomVisiblePoint(Rng& rng) {
  const double u_px = rng.Uniform(0, kWidth_px);
  const double v_px = rng.Uniform(0, kHeight_px);
  return kCamera.Unproject({u_px, v_px}) * rng.Uniform(1.0, 5.0);
}

}  // namespace mapp::test
