#pragma once

#include "mapp/base/rng.h"
#include "mapp/camera/camera_model.h"
#include "sim/scene.h"

#include <cstdint>
#include <memory>

namespace mapp::sim {

inline Camera SmallCamera() { return {PinholeCamera{100, 90, 39.5, 29.5}, 80, 60}; }

inline Quad PlainQuad(const Eigen::Vector3d& corner, const Eigen::Vector3d& edge_u, const Eigen::Vector3d& edge_v,
                      uint8_t level = 100) {
  return Quad{corner, edge_u, edge_v, std::make_shared<const Texture>(GrayImage(8, 8, level))};
}

/// A camera at the origin looks along world z; walls face it.
inline Scene OneWall(double z_m, uint8_t level) {
  return {{PlainQuad({-50, -50, z_m}, {100, 0, 0}, {0, 100, 0}, level)}};
}

inline Eigen::Vector3d RandomPoint(Rng& rng, double half_m) {
  return {rng.Uniform(-half_m, half_m), rng.Uniform(-half_m, half_m), rng.Uniform(-half_m, half_m)};
}

}  // namespace mapp::sim
