#include "sim/bake_lights.h"

#include "mapp/base/check.h"
#include "mapp/base/parallel.h"
#include "sim/scene_rays.h"

#include <algorithm>
#include <cmath>
#include <memory>
#include <utility>
#include <vector>

namespace mapp::sim {
namespace {

constexpr int kMaxNodes = 1024;  // per edge
/// What adds less to the brightness than this, a gray level or so, is left out, and its shadow rays with it.
constexpr double kDarkest = 0.004;
/// Surfaces this near to a node do not shade it: it lies on one of them.
constexpr double kMargin_m = 0.02;
/// Nodes on a border are lit as the points this far inside: the border itself often lies within another surface.
constexpr double kInset_m = 0.03;

int NumNodes(double edge_m, double spacing_m) {
  return static_cast<int>(std::clamp(std::ceil(edge_m / spacing_m) + 1, 2.0, double{kMaxNodes}));
}

/// Share along an edge of node `i` of `count`, moved inside by the inset.
double Along(int i, int count, double edge_m) {
  const double inset = std::min(kInset_m / edge_m, 0.25);
  return std::clamp(static_cast<double>(i) / (count - 1), inset, 1 - inset);
}

class Baker {
 public:
  Baker(const Scene& scene, std::span<const Light> lights, double ambient)
      : lights_(lights), ambient_(ambient), rays_(std::shared_ptr<const Scene>(std::shared_ptr<void>(), &scene)) {
    for (const Quad& quad : scene.quads) {
      bounds_.extend(quad.corner_world);
      bounds_.extend(quad.corner_world + quad.edge_u_world);
      bounds_.extend(quad.corner_world + quad.edge_v_world);
      bounds_.extend(quad.corner_world + quad.edge_u_world + quad.edge_v_world);
    }
  }

  /// Fills one row of nodes of the quad's grid.
  void Bake(const Quad& quad, int row, LightGrid& grid) const {
    const double width_m = quad.edge_u_world.norm();
    const Eigen::Vector3d normal_world = quad.NormalWorld();
    const Eigen::Vector3d row_world =
        quad.corner_world + Along(row, grid.rows, quad.edge_v_world.norm()) * quad.edge_v_world;
    float* factors = &grid.factors[static_cast<size_t>(row) * static_cast<size_t>(grid.columns)];
    for (int column = 0; column < grid.columns; ++column) {
      const Eigen::Vector3d p_world = row_world + Along(column, grid.columns, width_m) * quad.edge_u_world;
      factors[column] = static_cast<float>(BrightnessAt(p_world, normal_world));
    }
  }

 private:
  double BrightnessAt(const Eigen::Vector3d& p_world, const Eigen::Vector3d& normal_world) const {
    double brightness = ambient_;
    for (const Light& light : lights_) {
      const double unshadowed = UnshadowedLight(light.strength, light.reach_m, light.p_world - p_world, normal_world);
      if (unshadowed > kDarkest && !InShadow(light, p_world)) brightness += unshadowed;
    }
    return brightness;
  }

  bool InShadow(const Light& light, const Eigen::Vector3d& p_world) const {
    // Rays from the sun start where the scene does: numbers of its size are too coarse.
    const Eigen::Vector3d to_light = light.p_world - p_world;
    const double longest_m = bounds_.diagonal().norm() + 1;
    const double share = std::min(1.0, longest_m / to_light.norm());
    return rays_.Occluded(p_world + share * to_light, p_world, kMargin_m);
  }

  const std::span<const Light> lights_;
  const double ambient_;
  const SceneRays rays_;
  Eigen::AlignedBox3d bounds_;
};

}  // namespace

void BakeLights(Scene& scene, std::span<const Light> lights, double ambient, const BakeOptions& options) {
  MAPP_CHECK(options.spacing_m > 0 && options.num_threads >= 1);
  const Baker baker(scene, lights, ambient);
  std::vector<std::pair<size_t, int>> rows;  // of all surfaces: index of the surface, row of its grid
  for (size_t i = 0; i < scene.quads.size(); ++i) {
    Quad& quad = scene.quads[i];
    LightGrid& grid = quad.light;
    grid.columns = NumNodes(quad.edge_u_world.norm(), options.spacing_m);
    grid.rows = NumNodes(quad.edge_v_world.norm(), options.spacing_m);
    grid.factors.assign(static_cast<size_t>(grid.columns) * static_cast<size_t>(grid.rows), 0);
    for (int row = 0; row < grid.rows; ++row) rows.emplace_back(i, row);
  }
  ParallelFor(options.num_threads, static_cast<int>(rows.size()), [&](int i) {
    const auto [quad_idx, row] = rows[static_cast<size_t>(i)];
    baker.Bake(scene.quads[quad_idx], row, scene.quads[quad_idx].light);
  });
}

}  // namespace mapp::sim
