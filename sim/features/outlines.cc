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
/// Contrast of the strongest, gray levels.
constexpr double kMaxContrast = 90;
/// How fast it changes with the direction, radians of a wave per unit of direction.
constexpr double kContrastWaves = 12;
/// Share of the contrast that flat corners keep, the mean of the others.
constexpr float kFlatShare = 2 / std::numbers::pi_v<float>;

constexpr std::array<std::pair<int, int>, 4> kCorners = {{{0, 0}, {1, 0}, {1, 1}, {0, 1}}};

Eigen::Vector3d CornerWorld(const FeatureSurface& surface, size_t corner) {
  return surface.corner_world + kCorners[corner].first * surface.edge_u_world +
         kCorners[corner].second * surface.edge_v_world;
}

/// What meets in a vertex: how many surfaces' corners lie in each plane.
struct Vertex {
  uint64_t id = 0;
  uint32_t number = 0;
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

OutlineCorner MakeCorner(const FeatureSurface& surface, size_t corner, const Vertex& vertex) {
  OutlineCorner made;
  made.id = vertex.id;
  made.number = vertex.number;
  made.is_flat = vertex.planes.size() == 1;
  made.look = LookOf(surface, corner, vertex.id);
  if (made.is_flat) {
    made.phase = std::asin(kFlatShare);
    return made;
  }
  Rng rng(vertex.id);
  for (float& along : made.wave) along = static_cast<float>(kContrastWaves * rng.Uniform(-1, 1));
  made.phase = static_cast<float>(rng.Uniform(0, 2 * std::numbers::pi));
  return made;
}

}  // namespace

uint32_t FindOutlines(std::span<FeatureSurface> surfaces) {
  using Place = std::tuple<uint32_t, int64_t, int64_t, int64_t>;
  std::map<Place, Vertex> vertices;
  const auto place_of = [](const FeatureSurface& surface, size_t corner) {
    const Eigen::Vector3d p = CornerWorld(surface, corner) / kWeld_m;
    return Place(surface.object_id, std::llround(p.x()), std::llround(p.y()), std::llround(p.z()));
  };
  for (const FeatureSurface& surface : surfaces) {
    for (size_t corner = 0; corner < kCorners.size(); ++corner) {
      Vertex& vertex = vertices[place_of(surface, corner)];
      if (vertex.id == 0) {
        vertex.id = Hash(surface.id, corner) | 1U;
        vertex.number = static_cast<uint32_t>(vertices.size() - 1);
      }
      vertex.Add(surface.normal_world);
    }
  }
  for (FeatureSurface& surface : surfaces) {
    for (size_t corner = 0; corner < kCorners.size(); ++corner) {
      const Vertex& vertex = vertices[place_of(surface, corner)];
      if (vertex.IsCorner()) surface.outline[corner] = MakeCorner(surface, corner, vertex);
    }
  }
  return static_cast<uint32_t>(vertices.size());
}

void FindOutlineCandidates(const FeatureSurface& surface, const FeatureView& view, double border_px,
                           std::vector<bool>& seen, std::vector<FeatureCandidate>& candidates) {
  const Eigen::Vector3d& eye_world = view.T_world_camera.translation();
  const double height_m = surface.normal_world.dot(eye_world - surface.corner_world);
  const double edge_m = std::min(surface.length_u_m, surface.length_v_m);
  const double farthest_m = std::min(edge_m * view.focal_px / kMinOutlineEdge_px, height_m / kMinRimCosine);
  for (size_t i = 0; i < kCorners.size(); ++i) {
    const OutlineCorner& corner = surface.outline[i];
    if (corner.id == 0 || seen[corner.number]) continue;
    const Eigen::Vector3d to_eye_world = eye_world - CornerWorld(surface, i);
    const double distance_m = to_eye_world.norm();
    if (distance_m > farthest_m) continue;
    const Eigen::Vector3d p_camera = -(view.R_camera_world * to_eye_world);
    if (p_camera.z() < kNearest_m || !view.InPyramid(p_camera)) continue;
    seen[corner.number] = true;
    const auto along_wave = static_cast<float>(corner.wave.cast<double>().dot(to_eye_world) / distance_m);
    const Eigen::Vector2d fraction(kCorners[i].first, kCorners[i].second);
    const double response = static_cast<double>(corner.look.response * std::abs(std::sin(along_wave + corner.phase))) *
                            surface.Light(fraction);
    if (response < kMinResponse) continue;
    const Eigen::Vector2d pixel = view.camera.Project(p_camera);
    const double edge_px = edge_m * view.focal_px / distance_m;
    const double size = std::log(distance_m / view.focal_px / kStepPitch_m) / kLogPyramidScale;
    const int size_step = static_cast<int>(std::lround(size));
    for (int octave = 0; octave < kPyramidLevels; ++octave) {
      const auto scale = static_cast<double>(OctaveScale(octave));
      if (edge_px < kMinOutlineEdge_px * scale || !view.camera.Contains(pixel, border_px * scale)) break;
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
      candidate.view_cosine = std::max(height_m / distance_m, kMinViewCosine);
      candidate.response = response;
    }
  }
}

}  // namespace mapp::sim
