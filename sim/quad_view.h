#pragma once

#include "mapp/geometry/pose3.h"
#include "sim/four.h"
#include "sim/ray_table.h"
#include "sim/scene.h"

#include <Eigen/Core>

#include <array>
#include <cstdint>
#include <optional>

namespace mapp::sim {

/// A rectangle as one camera sees it. With the ray d = (x, y, 1), inverse depth 1/z, u/z and v/z are linear in d (Blinn
/// 1992, "Hyperbolic interpolation"), so that depth and texture coordinates are exact and cheap for any ray.
struct QuadView {
  const Quad* quad = nullptr;
  std::array<Eigen::Vector3d, 4> outline_camera;
  Eigen::Vector3d inverse_depth;  ///< 1/z = inverse_depth . d
  Eigen::Vector3d u_over_z;       ///< u in [0, 1] on the surface
  Eigen::Vector3d v_over_z;

  double InverseDepth(double x, double y) const {
    return inverse_depth.x() * x + inverse_depth.y() * y + inverse_depth.z();
  }
};

/// The index of a view where a ray meets none of the views.
inline constexpr int32_t kNoView = -1;

/// Finds the rectangles that a camera may see.
class ViewFinder {
 public:
  ViewFinder(const Eigen::AlignedBox2f& ray_bounds, const Pose3& T_world_camera);

  /// Nullopt for a rectangle that shows its back or lies outside the field of view.
  std::optional<QuadView> Find(const Quad& quad) const;

 private:
  const Pose3 T_camera_world_;
  const Eigen::Matrix3d R_camera_world_;
  const Eigen::Vector3d p_world_;                ///< of the camera
  std::array<Eigen::Vector3d, 5> inward_world_;  ///< unit normals of the field of view's sides
};

/// Nearest depth that is drawn, metres.
inline constexpr double kNearest_m = 0.02;

/// Linear function of a ray's difference from a given one.
struct RayLinear {
  float at_ray = 0;
  float per_x = 0;
  float per_y = 0;
  RayLinear() = default;
  /// `coefficients` . (x, y, 1). Only differences from `ray` are counted in float: 1e-7 of a coordinate of 100 m would
  /// be seen.
  RayLinear(const Eigen::Vector3d& coefficients, const Eigen::Vector2f& ray)
      : at_ray(static_cast<float>(coefficients.dot(ray.cast<double>().homogeneous()))),
        per_x(static_cast<float>(coefficients.x())),
        per_y(static_cast<float>(coefficients.y())) {}
  Eigen::Array4f operator()(const RayRow& off) const { return at_ray + per_x * off.x + per_y * off.y; }
};

/// Where the rays around a given one meet a rectangle.
class QuadHit {
 public:
  QuadHit(const QuadView& view, const Eigen::Vector2f& ray)
      : ray_(ray),
        inverse_depth_(view.inverse_depth, ray),
        u_over_z_(view.u_over_z, ray),
        v_over_z_(view.v_over_z, ray) {}

  /// The inverse depth at which rays meet the rectangle, 1/m; 0 where they pass it by.
  Eigen::Array4f InverseDepth(const RayRow& rays) const {
    // u and v in [0, 1], multiplied by 1/z; rectangles that touch leave no gap between them.
    constexpr float kSlack = 1e-5F;
    const RayRow off{rays.x - ray_.x(), rays.y - ray_.y()};
    const Eigen::Array4f inverse_depth = inverse_depth_(off);
    const Float4 low = -kSlack * ToFour(inverse_depth);
    const Float4 high = (1 + kSlack) * ToFour(inverse_depth);
    const Float4 u = ToFour(u_over_z_(off));
    const Float4 v = ToFour(v_over_z_(off));
    const auto is_met = (low < 0.0F) & (u >= low) & (u <= high) & (v >= low) & (v <= high);
    return Masked(reinterpret_cast<Int4>(is_met), inverse_depth);
  }

 private:
  Eigen::Vector2f ray_;
  RayLinear inverse_depth_;
  RayLinear u_over_z_;
  RayLinear v_over_z_;
};

/// The appearance of a rectangle around one ray: gray levels by trilinear texture lookups, and depth.
class SurfacePatch {
 public:
  SurfacePatch() = default;
  /// Around `ray`, which must meet the rectangle's plane in front of the camera. `ray_per_x` and `ray_per_y`: how the
  /// ray changes from a pixel to the next.
  SurfacePatch(const QuadView& view, const Eigen::Vector2f& ray, const Eigen::Vector2f& ray_per_x,
               const Eigen::Vector2f& ray_per_y);

  /// Gray levels at which nearby rays meet the rectangle's plane, which they must do in front of the camera.
  Eigen::Array4f GrayAt(const RayRow& rays) const;

  struct Look {
    std::array<Eigen::Array4f, RayRow::kSize> gray;
    std::array<Eigen::Array4f, RayRow::kSize> depth_m;
  };
  /// What the pixels of a cell see, four rows of four, likewise.
  Look LookAt(const std::array<RayRow, RayRow::kSize>& rays) const;

  /// The inverse depth at which nearby rays meet the rectangle's plane, 1/m.
  Eigen::Array4f InverseDepthOf(const RayRow& rays) const { return inverse_depth_(OffOf(rays)); }
  /// The ray around which this is.
  const Eigen::Vector2f& ray() const { return ray_; }
  const Eigen::Vector3f& tint_rgb() const { return quad_->tint_rgb; }

 private:
  void ChooseLookup(const Eigen::Vector2f& ray_per_x, const Eigen::Vector2f& ray_per_y);
  RayRow OffOf(const RayRow& rays) const { return {rays.x - ray_.x(), rays.y - ray_.y()}; }
  Texture::Slice SliceAt(float depth_m) const;
  Eigen::Array4f Texels(const RayRow& off, const Eigen::Array4f& depth_m, const Texture::Slice& slice) const;
  Eigen::Array4f Brightness(const RayRow& off, const Eigen::Array4f& depth_m) const;

  const Quad* quad_ = nullptr;
  const Texture* texture_ = nullptr;
  Eigen::Vector2f ray_ = Eigen::Vector2f::Zero();
  RayLinear inverse_depth_;
  RayLinear u_over_z_;  ///< of the surface
  RayLinear v_over_z_;
  RayLinear texture_u_over_z_;
  RayLinear texture_v_over_z_;
  float depth_m_ = 0;          ///< at `ray_`
  float level_ = 0;            ///< mip level at `ray_`
  float level_per_log2z_ = 0;  ///< how it grows with depth
  int num_taps_ = 1;
  Eigen::Vector2f tap_uv_ = Eigen::Vector2f::Zero();  ///< step from one lookup to the next, in the texture
  Texture::Beyond beyond_ = Texture::Beyond::kClamp;
};

}  // namespace mapp::sim
