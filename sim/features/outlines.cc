#include "sim/features/outlines.h"

#include "sim/features/appearance.h"
#include "sim/features/hash.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <map>
#include <numbers>
#include <tuple>
#include <utility>

namespace mapp::sim {
namespace {

/// Vertices this near to each other are one.
constexpr double kWeld_m = 0.004;
constexpr double kSameNormal = 0.999;
/// Pixels of this size, where they show the corner, are step 0.
constexpr double kStepPitch_m = 0.001;
/// A surface shorter than this in pixels of an octave has no corners there.
constexpr double kMinEdge_px = 4;
/// Contrast of the strongest, gray levels.
constexpr double kMaxContrast = 90;
/// How fast it changes with the direction, radians of a wave per unit of direction.
constexpr double kContrastWaves = 12;
/// Share of the contrast that flat corners keep, the mean of the others.
constexpr double kFlatShare = 2 / std::numbers::pi;
/// Flatter than this a surface shows nothing but its rim.
constexpr double kMinRimCosine = 0.03;

constexpr std::array<std::pair<int, int>, 4> kCorners = {{{0, 0}, {1, 0}, {1, 1}, {0, 1}}};

Eigen::Vector3d CornerWorld(const FeatureSurface& surface, size_t corner) {
  return surface.corner_world + kCorners[corner].first * surface.edge_u_world +
         kCorners[corner].second * surface.edge_v_world;
}

/// What meets in a vertex: how many surfaces' corners lie in each plane.
struct Vertex {
  uint64_t id = 0;
  std::vector<std::pair<Eigen::Vector3d, int>> planes;

  void Add(const Eigen::Vector3d& normal_world) {
    for (auto& [plane_world, count] : planes) {
      if (plane_world.dot(normal_world) < kSameNormal) continue;
      ++count;
      return;
    }
    planes.emplace_back(normal_world, 1);
  }
  /// Two right angles make a straight edge, four an inner point.
  bool IsCorner() const {
    return std::any_of(planes.begin(), planes.end(), [](const auto& plane) { return plane.second % 2 == 1; });
  }
};

/// Equal things have equal corners; what stands behind them differs.
TextureCorner LookOf(const FeatureSurface& surface, size_t corner, uint64_t id) {
  const uint64_t thing = Hash(static_cast<uint64_t>(std::lround(surface.length_u_m * 1e3)),
                              static_cast<uint64_t>(std::lround(surface.length_v_m * 1e3)), corner);
  TextureCorner look;
  look.angle = static_cast<float>((0.25 + 0.5 * static_cast<double>(corner)) * std::numbers::pi);
  look.response = static_cast<float>(kMaxContrast * Rng(thing).Uniform());
  look.descriptor = OutlineDescriptor(thing, id);
  return look;
}

/// What stands behind a corner is as bright or dark as itself from some directions: a wave over the directions.
double ContrastShare(uint64_t id, const Eigen::Vector3d& to_eye_world) {
  Rng rng(id);
  const Eigen::Vector3d wave(rng.Uniform(-1, 1), rng.Uniform(-1, 1), rng.Uniform(-1, 1));
  const double phase = rng.Uniform(0, 2 * std::numbers::pi);
  return std::abs(std::sin(kContrastWaves * wave.dot(to_eye_world) + phase));
}

}  // namespace

void FindOutlines(std::span<FeatureSurface> surfaces) {
  using Place = std::tuple<uint32_t, int64_t, int64_t, int64_t>;
  std::map<Place, Vertex> vertices;
  const auto place_of = [](const FeatureSurface& surface, size_t corner) {
    const Eigen::Vector3d p = CornerWorld(surface, corner) / kWeld_m;
    return Place(surface.object_id, std::llround(p.x()), std::llround(p.y()), std::llround(p.z()));
  };
  for (const FeatureSurface& surface : surfaces) {
    for (size_t corner = 0; corner < kCorners.size(); ++corner) {
      Vertex& vertex = vertices[place_of(surface, corner)];
      if (vertex.id == 0) vertex.id = Hash(surface.id, corner) | 1U;
      vertex.Add(surface.normal_world);
    }
  }
  for (FeatureSurface& surface : surfaces) {
    for (size_t corner = 0; corner < kCorners.size(); ++corner) {
      const Vertex& vertex = vertices[place_of(surface, corner)];
      if (!vertex.IsCorner()) continue;
      surface.outline[corner] = {vertex.id, vertex.planes.size() == 1, LookOf(surface, corner, vertex.id)};
    }
  }
}

void FindOutlineCandidates(const FeatureSurface& surface, const FeatureView& view, double border_px,
                           std::unordered_set<uint64_t>& seen, std::vector<FeatureCandidate>& candidates) {
  const double height_m =
      -(view.T_camera_world.rotation() * surface.normal_world).dot(view.T_camera_world * surface.corner_world);
  const double edge_m = std::min(surface.length_u_m, surface.length_v_m);
  for (size_t i = 0; i < kCorners.size(); ++i) {
    const OutlineCorner& corner = surface.outline[i];
    if (corner.id == 0) continue;
    const Eigen::Vector3d p_camera = view.T_camera_world * CornerWorld(surface, i);
    if (p_camera.z() < kNearest_m || !view.InPyramid(p_camera)) continue;
    const double distance_m = p_camera.norm();
    const double cosine = height_m / distance_m;
    const double edge_px = edge_m * view.focal_px / distance_m;
    if (cosine < kMinRimCosine || edge_px < kMinEdge_px || !seen.insert(corner.id).second) continue;
    const Eigen::Vector2d fraction(kCorners[i].first, kCorners[i].second);
    const Eigen::Vector3d to_eye_world = view.T_world_camera.rotation() * p_camera / -distance_m;
    const double response = static_cast<double>(corner.look.response) * surface.Light(fraction) *
                            (corner.is_flat ? kFlatShare : ContrastShare(corner.id, to_eye_world));
    if (response < kMinResponse) continue;
    const Eigen::Vector2d pixel = view.camera.Project(p_camera);
    const double size = std::log(distance_m / view.focal_px / kStepPitch_m) / kLogPyramidScale;
    const int size_step = static_cast<int>(std::lround(size));
    for (int octave = 0; octave < kPyramidLevels; ++octave) {
      const auto scale = static_cast<double>(OctaveScale(octave));
      if (edge_px < kMinEdge_px * scale || !view.camera.Contains(pixel, border_px * scale)) break;
      FeatureCandidate& candidate = candidates.emplace_back();
      candidate.surface = &surface;
      candidate.corner = &corner.look;
      candidate.outline = &corner;
      candidate.landmark = Hash(corner.id, static_cast<uint64_t>(size_step + octave)) | 1U;
      candidate.fraction = fraction;
      candidate.p_camera = p_camera;
      candidate.pixel = pixel;
      candidate.octave = octave;
      candidate.scale_misfit = size_step - size;
      candidate.size_step = size_step + octave;
      candidate.view_cosine = std::max(cosine, kMinViewCosine);
      candidate.response = response;
    }
  }
}

}  // namespace mapp::sim
