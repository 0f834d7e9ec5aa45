#pragma once

#include "mapp/base/mutex.h"
#include "sim/features/texture_corners.h"
#include "sim/scene.h"
#include "sim/scene_rays.h"
#include "sim/world/world.h"

#include <Eigen/Core>

#include <array>
#include <cstdint>
#include <map>
#include <memory>
#include <tuple>
#include <vector>

namespace mapp::sim {

/// A corner of a surface's outline, where the thing that it is part of ends.
struct OutlineCorner {
  uint64_t id = 0;      ///< of the place, through time; 0: nothing ends here, as where panels meet
  uint32_t number = 0;  ///< among the scene's; surfaces that meet in a corner share it
  bool is_flat = true;  ///< painted on or hung flat before something, which then stands behind it in every view
  TextureCorner look;   ///< its place is the outline's
  /// What stands behind it is as bright or dark as itself from some directions: a wave over the directions to the eye.
  Eigen::Vector3f wave = Eigen::Vector3f::Zero();
  float phase = 0;
};

/// A surface with the corners on it. Landmarks are not stored: one is a corner of the picture at a place of the
/// surface.
struct FeatureSurface {
  Eigen::Vector3d corner_world;
  Eigen::Vector3d edge_u_world;
  Eigen::Vector3d edge_v_world;
  Eigen::Vector3d normal_world;
  double length_u_m = 0;
  double length_v_m = 0;
  std::shared_ptr<const TextureCorners> picture;
  /// Fraction f of the surface shows fraction start + f * span of the (mirrored, repeating) picture.
  Eigen::Vector2d start;
  Eigen::Vector2d span;
  LightGrid light;
  std::array<OutlineCorner, 4> outline;  ///< at fractions (0, 0), (1, 0), (1, 1), (0, 1)
  uint64_t id = 0;                       ///< of the surface through time: where its object stands does not matter
  uint32_t object_id = 0;

  /// Brightness at a fraction of the surface, in [0, 1]^2.
  double Light(const Eigen::Vector2d& fraction) const;
};

/// A ball round a surface and the plane it lies in: what is out of sight is seen from these alone.
struct SurfaceBounds {
  explicit SurfaceBounds(const FeatureSurface& surface);
  Eigen::Vector3f center_world;
  float radius_m;
  Eigen::Vector3f normal_world;
  float plane_offset_m;  ///< normal . p of the plane's points
  float shorter_edge_m;
  bool has_outline;  ///< some of its corners are an outline's
};

/// The world between two of its changes, or the people in it at a moment. Immutable.
struct FeatureScene {
  std::vector<FeatureSurface> surfaces;
  std::vector<SurfaceBounds> bounds;  ///< of each surface
  uint32_t num_outline_corners = 0;
  std::unique_ptr<const SceneRays> rays;
};

/// A world as features. A landmark is a corner of a surface's picture: things with the same textures carry the same
/// landmarks at the same places with the same descriptors, so that what looks alike in images looks alike here.
/// Thread-safe.
class FeatureWorld {
 public:
  /// `world` must not be null.
  explicit FeatureWorld(std::shared_ptr<const World> world);

  /// The surroundings and what stands in them at a time. Built once between two changes.
  std::shared_ptr<const FeatureScene> At(int64_t stamp_ns) const;
  /// People at a time: they carry landmarks like anything else, and hide what is behind them. Null without any.
  std::shared_ptr<const FeatureScene> PassersAt(int64_t stamp_ns) const;
  const World& world() const { return *world_; }

 private:
  using PictureKey = std::tuple<const Texture*, bool, int>;  ///< texture, mirrored, steps of aspect

  FeatureSurface MakeSurface(const Quad& quad, uint64_t id) const;
  std::shared_ptr<const TextureCorners> PictureOf(const Quad& quad, double log_aspect) const;
  std::shared_ptr<const Scene> LitScene(int64_t stamp_ns) const;
  std::shared_ptr<const FeatureScene> Build(int64_t stamp_ns) const;

  std::shared_ptr<const World> world_;
  std::vector<int64_t> change_stamps_ns_;
  mutable Mutex mutex_;
  mutable std::map<size_t, std::shared_ptr<const FeatureScene>> scenes_ ABSL_GUARDED_BY(mutex_);  ///< by changes so far
  mutable std::map<PictureKey, std::shared_ptr<const TextureCorners>> pictures_ ABSL_GUARDED_BY(mutex_);
};

}  // namespace mapp::sim
