#include "sim/features/appearance.h"

#include "sim/features/hash.h"

#include <algorithm>
#include <array>
#include <bit>
#include <cmath>

namespace mapp::sim {
namespace {

/// What appearance changes with.
enum WalkDomain : uint8_t {
  kForeshortening0,
  kForeshortening1,
  kScale,
  kSize,
  kDirectionX,
  kDirectionY,
  kDirectionZ,
  kNumWalks
};

/// Hash domains.
enum : uint64_t { kThing = 1, kPlace, kSteady };

/// Bits flip this many at a step, at places that the step's hash gives.
constexpr int kBitsPerStep = 4;
/// Outlines, set on rendered views of a garage (docs/evaluation/feature_level.md). They look like one of a few shapes;
/// so many bits differ from thing to thing and from place to place,
constexpr uint64_t kNumShapes = 3;
constexpr int kBitsOfThing = 6;
constexpr int kBitsOfPlace = 6;
/// from an octave to the next, as for corners of textures,
constexpr double kOutlineSizeBits = 64;
/// and per unit of direction to the eye where something else stands behind.
constexpr double kOutlineDirectionBits = 1000;

void FlipBits(uint64_t places, int num_bits, OrbDescriptor& descriptor) {
  for (int i = 0; i < num_bits; ++i, places >>= 8) {
    descriptor.words[(places >> 6) & 3U] ^= uint64_t{1} << (places & 63U);
  }
}

void FlipBitsOf(Rng& rng, int num_bits, OrbDescriptor& descriptor) {
  for (; num_bits > 0; num_bits -= kBitsPerStep) FlipBits(rng.Next(), std::min(num_bits, kBitsPerStep), descriptor);
}

/// Appearance changes with a parameter step by step, each step flipping bits of its own: two views differ by the steps
/// between them. They are the same bits for all corners: what looks alike, such as a corner at two levels of its
/// texture, still does when both are seen from the side.
class BitWalk {
 public:
  explicit BitWalk(uint64_t domain) {
    Rng rng(domain);
    for (size_t i = 1; i < masks_.size(); ++i) {
      masks_[i] = masks_[i - 1];
      FlipBits(rng.Next(), kBitsPerStep, masks_[i]);
    }
  }
  /// Goes round, long after nothing is alike any more.
  void Flip(double bits, OrbDescriptor& descriptor) const {
    // The ends of the walk do not meet: they lie far from where it begins.
    const auto step = (static_cast<uint64_t>(std::lround(bits / kBitsPerStep)) + masks_.size() / 2) % masks_.size();
    for (size_t i = 0; i < descriptor.words.size(); ++i) descriptor.words[i] ^= masks_[step].words[i];
  }

 private:
  std::array<OrbDescriptor, 512> masks_{};
};

void FlipAlong(double bits, WalkDomain domain, OrbDescriptor& descriptor) {
  static const std::array<BitWalk, kNumWalks> kWalks = {BitWalk(1), BitWalk(2), BitWalk(3), BitWalk(4),
                                                        BitWalk(5), BitWalk(6), BitWalk(7)};
  kWalks[domain].Flip(bits, descriptor);
}

/// Poisson-like number of mean `mean`, by the sum of a uniform's position: cheap, and never far off.
int DrawCount(double mean, Rng& rng) { return static_cast<int>(std::lround(mean * (0.5 + rng.Uniform()))); }

uint64_t AppearanceOf(const TextureCorner& corner) {
  const std::array<uint64_t, 4>& words = corner.descriptor.words;
  return words[0] ^ std::rotl(words[1], 17) ^ std::rotl(words[2], 31) ^ std::rotl(words[3], 47);
}

/// A flat patch is squeezed along the direction of tilt by its cosine; which way round does not matter, hence twice the
/// angle (Mikolajczyk et al. 2005: affine shape has two parameters besides scale and rotation).
void Foreshorten(const FeatureCandidate& candidate, const Eigen::Vector3d& to_eye_world, double view_bits,
                 OrbDescriptor& descriptor) {
  const FeatureSurface& surface = *candidate.surface;
  const double along_u = to_eye_world.dot(surface.edge_u_world) / surface.length_u_m;
  const double along_v = to_eye_world.dot(surface.edge_v_world) / surface.length_v_m;
  if (along_u == 0 && along_v == 0) return;
  const double bits = -std::log(candidate.view_cosine) * view_bits;
  const double twice = 2 * std::atan2(along_v, along_u);
  FlipAlong(bits * std::cos(twice), kForeshortening0, descriptor);
  FlipAlong(bits * std::sin(twice), kForeshortening1, descriptor);
}

/// Some change faster than others: a plain right angle looks alike at any size.
void ChangeOutline(const OutlineCorner& corner, int size_step, const Eigen::Vector3d& to_eye_world,
                   OrbDescriptor& descriptor) {
  Rng rng(Hash(corner.id, kSteady));
  const auto pace = [&] { return -std::log(1 - rng.Uniform()); };
  FlipAlong(pace() * size_step * kOutlineSizeBits, kSize, descriptor);
  if (corner.is_flat) return;
  const double bits = pace() * kOutlineDirectionBits;
  FlipAlong(to_eye_world.x() * bits, kDirectionX, descriptor);
  FlipAlong(to_eye_world.y() * bits, kDirectionY, descriptor);
  FlipAlong(to_eye_world.z() * bits, kDirectionZ, descriptor);
}

}  // namespace

OrbDescriptor Describe(const FeatureCandidate& candidate, const FeatureView& view, const FeatureNoise& noise,
                       Rng& rng) {
  OrbDescriptor descriptor = candidate.corner->descriptor;
  const Eigen::Vector3d to_eye_world = -(view.R_camera_world.transpose() * candidate.p_camera).normalized();
  Foreshorten(candidate, to_eye_world, noise.view_bits, descriptor);
  if (candidate.outline != nullptr) ChangeOutline(*candidate.outline, candidate.size_step, to_eye_world, descriptor);
  FlipAlong(candidate.scale_misfit * noise.scale_bits, kScale, descriptor);
  // Some corners are described alike in every image, others by comparisons of nearly equal grays.
  const double chance = Rng(AppearanceOf(*candidate.corner)).Uniform();
  const double fragility = 0.25 + 2.25 * chance * chance;
  FlipBitsOf(rng, DrawCount(fragility * noise.random_bits, rng), descriptor);
  return descriptor;
}

float ImageAngle(const FeatureCandidate& candidate, const FeatureView& view) {
  const FeatureSurface& surface = *candidate.surface;
  const auto angle = static_cast<double>(candidate.corner->angle);
  const Eigen::Vector3d d_world = std::cos(angle) * surface.edge_u_world / surface.length_u_m +
                                  std::sin(angle) * surface.edge_v_world / surface.length_v_m;
  const Eigen::Vector3d d_camera = view.R_camera_world * d_world;
  const Eigen::Vector3d& p = candidate.p_camera;
  return static_cast<float>(
      std::atan2(d_camera.y() * p.z() - p.y() * d_camera.z(), d_camera.x() * p.z() - p.x() * d_camera.z()));
}

OrbDescriptor OutlineDescriptor(uint64_t thing, uint64_t place) {
  Rng of_thing(Hash(thing, kThing)), of_place(Hash(place, kPlace));
  Rng of_shape(of_thing.Below(kNumShapes));
  OrbDescriptor descriptor;
  for (uint64_t& word : descriptor.words) word = of_shape.Next();
  FlipBitsOf(of_thing, kBitsOfThing, descriptor);
  FlipBitsOf(of_place, kBitsOfPlace, descriptor);
  return descriptor;
}

}  // namespace mapp::sim
