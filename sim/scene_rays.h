#pragma once

#include "sim/scene.h"

#include <Eigen/Core>

#include <cstdint>
#include <memory>
#include <span>
#include <vector>

namespace mapp::sim {

class EmbreeScene;

/// Questions to a scene's geometry: what sees what, and how far the nearest surface is. World frame, metres.
/// Immutable, thread-safe.
class SceneRays {
 public:
  /// `scene` must not be null; it is shared.
  explicit SceneRays(std::shared_ptr<const Scene> scene);
  ~SceneRays();
  SceneRays(const SceneRays&) = delete;
  SceneRays& operator=(const SceneRays&) = delete;

  /// Whether a surface hides `p_to_world` from a viewer at `p_from_world`. Surfaces nearer than `margin_m` to
  /// `p_to_world` along the ray do not count: a point on a surface is not hidden by that surface. Surfaces that show
  /// the viewer their back hide nothing. Exact to about 1e-6 of the coordinates.
  bool Occluded(const Eigen::Vector3d& p_from_world, const Eigen::Vector3d& p_to_world, double margin_m) const;
  /// The same for many points from one viewer: 1 where hidden, else 0; as many as `p_to_world`.
  std::vector<uint8_t> Occluded(const Eigen::Vector3d& p_from_world, std::span<const Eigen::Vector3d> p_to_world,
                                double margin_m) const;

  /// Exact distance to the nearest surface, whichever side it shows; infinity in an empty scene.
  double DistanceToSurface(const Eigen::Vector3d& p_world) const;
  /// The same for many points; as many as `p_world`.
  std::vector<double> DistanceToSurface(std::span<const Eigen::Vector3d> p_world) const;

 private:
  const std::shared_ptr<const Scene> scene_;
  const std::unique_ptr<const EmbreeScene> embree_;
};

}  // namespace mapp::sim
