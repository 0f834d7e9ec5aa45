#pragma once

#include "mapp/geometry/pose3.h"
#include "sim/embree_scene.h"
#include "sim/quad_view.h"

#include <Eigen/Core>

#include <cstdint>
#include <memory>
#include <span>
#include <vector>

namespace mapp::sim {

/// Finds which rectangle each ray of one frame meets first. Thread-safe.
class RayCaster {
 public:
  /// `scene` holds `quads`; both, and `moving_quads`, must outlive this.
  RayCaster(const EmbreeScene& scene, std::span<const Quad> quads, std::span<const Quad> moving_quads,
            const Eigen::AlignedBox2f& ray_bounds, const Pose3& T_world_camera);

  /// The rectangles that the camera may see.
  const std::vector<QuadView>& views() const { return views_; }

  /// For each ray, given by its point on the plane z = 1 of the camera's frame, the index of the view that it meets, or
  /// kNoView. As many of both; neighbours should be neighbours in the image.
  void Cast(std::span<const Eigen::Vector2f> rays, std::span<int32_t> view_indices) const;

 private:
  void AddViews(std::span<const Quad> quads, const ViewFinder& finder, std::vector<int32_t>& view_of_quad);
  void Cast8(std::span<const Eigen::Vector2f> rays, std::span<int32_t> view_indices) const;

  const EmbreeScene& scene_;
  std::unique_ptr<const EmbreeScene> moving_scene_;  ///< null without any
  std::vector<QuadView> views_;
  std::vector<std::vector<int32_t>> view_of_quad_;  ///< by Embree's geomID and primID
  const Eigen::Matrix3f R_world_camera_;
  const Eigen::Vector3f p_world_;
};

}  // namespace mapp::sim
