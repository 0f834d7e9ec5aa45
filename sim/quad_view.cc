#include "sim/quad_view.h"

#include <Eigen/Geometry>

#include <algorithm>
#include <cmath>

namespace mapp::sim {
namespace {

/// Surfaces seen at a flat angle are looked up at several places along the pixel's long axis; beyond that many the
/// picture is blurred.
constexpr int kMaxTaps = 4;
/// A mip level is already a box filter; blending two of them over the whole pixel would blur twice.
constexpr float kSharpness = 0.7F;

bool Repeats(const TextureWindow& window) {
  const auto [u_low, u_high] = std::minmax(window.u0, window.u1);
  const auto [v_low, v_high] = std::minmax(window.v0, window.v1);
  return u_low < 0 || v_low < 0 || u_high > 1 || v_high > 1;
}

}  // namespace

ViewFinder::ViewFinder(const Eigen::AlignedBox2f& ray_bounds, const Pose3& T_world_camera)
    : T_camera_world_(T_world_camera.Inverse()),
      R_camera_world_(T_camera_world_.RotationMatrix()),
      p_world_(T_world_camera.translation()) {
  const Eigen::Vector2d low = ray_bounds.min().cast<double>();
  const Eigen::Vector2d high = ray_bounds.max().cast<double>();
  inward_world_ = {Eigen::Vector3d(0, 0, 1), Eigen::Vector3d(1, 0, -low.x()), Eigen::Vector3d(-1, 0, high.x()),
                   Eigen::Vector3d(0, 1, -low.y()), Eigen::Vector3d(0, -1, high.y())};
  for (Eigen::Vector3d& inward : inward_world_) inward = R_camera_world_.transpose() * inward.normalized();
}

std::optional<QuadView> ViewFinder::Find(const Quad& quad) const {
  const Eigen::Vector3d to_middle = quad.corner_world + 0.5 * (quad.edge_u_world + quad.edge_v_world) - p_world_;
  const double radius_m = 0.5 * (quad.edge_u_world + quad.edge_v_world).norm();
  constexpr double kMargin_m = 1e-3;
  for (const Eigen::Vector3d& inward : inward_world_) {
    if (inward.dot(to_middle) < -radius_m - kMargin_m) return std::nullopt;
  }
  const Eigen::Vector3d normal_world = quad.NormalWorld();
  const double offset_m = normal_world.dot(to_middle);  // negative when the camera is in front
  if (!(offset_m < -1e-6)) return std::nullopt;

  QuadView view;
  view.quad = &quad;
  const Eigen::Vector3d corner = T_camera_world_ * quad.corner_world;
  const Eigen::Vector3d edge_u = R_camera_world_ * quad.edge_u_world;
  const Eigen::Vector3d edge_v = R_camera_world_ * quad.edge_v_world;
  view.outline_camera = {corner, corner + edge_u, corner + edge_u + edge_v, corner + edge_v};
  // 1/z = n.d / offset and u = eu.(z d - corner) / |eu|^2, likewise v.
  view.inverse_depth = R_camera_world_ * normal_world / offset_m;
  const Eigen::Vector3d dual_u = edge_u / edge_u.squaredNorm();
  const Eigen::Vector3d dual_v = edge_v / edge_v.squaredNorm();
  view.u_over_z = dual_u - dual_u.dot(corner) * view.inverse_depth;
  view.v_over_z = dual_v - dual_v.dot(corner) * view.inverse_depth;
  return view;
}

SurfacePatch::SurfacePatch(const QuadView& view, const Eigen::Vector2f& ray, const Eigen::Vector2f& ray_per_x,
                           const Eigen::Vector2f& ray_per_y)
    : quad_(view.quad),
      ray_(ray),
      inverse_depth_slope_(view.inverse_depth.head<2>().cast<float>()),
      u_slope_(view.u_over_z.head<2>().cast<float>()),
      v_slope_(view.v_over_z.head<2>().cast<float>()),
      beyond_(Repeats(view.quad->window) ? Texture::Beyond::kRepeat : Texture::Beyond::kClamp) {
  // Only differences from here are counted in float: 1e-7 of a coordinate of 100 m would be seen.
  const Eigen::Vector3d d = ray.cast<double>().homogeneous();
  const double inverse_depth = view.inverse_depth.dot(d);
  inverse_depth_ = static_cast<float>(inverse_depth);
  depth_m_ = static_cast<float>(1.0 / inverse_depth);
  u_over_z_ = static_cast<float>(view.u_over_z.dot(d));
  v_over_z_ = static_cast<float>(view.v_over_z.dot(d));

  // The pixel's two axes on the texture, in texels, by the quotient rule.
  const TextureWindow& window = quad_->window;
  const Texture& texture = *quad_->texture;
  const Eigen::Vector2f window_size(window.u1 - window.u0, window.v1 - window.v0);
  const Eigen::Vector2f texels = window_size.cwiseProduct(
      Eigen::Vector2f(static_cast<float>(texture.width()), static_cast<float>(texture.height())));
  const Eigen::Vector2f uv = depth_m_ * Eigen::Vector2f(u_over_z_, v_over_z_);
  const auto on_surface = [&](const Eigen::Vector2f& step) {
    const Eigen::Vector2f over_z(u_slope_.dot(step), v_slope_.dot(step));
    return Eigen::Vector2f(depth_m_ * (over_z - uv * inverse_depth_slope_.dot(step)));
  };
  // Singular values and the long axis of the 2 x 2 Jacobian: the footprint's true shape, whichever way it lies.
  Eigen::Matrix2f J;  // texels per pixel
  J.col(0) = texels.cwiseProduct(on_surface(ray_per_x));
  J.col(1) = texels.cwiseProduct(on_surface(ray_per_y));
  const Eigen::Matrix2f outer = J * J.transpose();
  const float mean = 0.5F * (outer(0, 0) + outer(1, 1));
  const float spread = std::hypot(0.5F * (outer(0, 0) - outer(1, 1)), outer(0, 1));
  const float longest = std::sqrt(mean + spread);
  const float shortest = std::sqrt(std::max(mean - spread, 0.0F));
  num_taps_ = std::clamp(static_cast<int>(longest / std::max(shortest, 1.0F)), 1, kMaxTaps);
  const float footprint = std::max(shortest, longest / static_cast<float>(num_taps_));
  level_ = Texture::FastLog2(std::max(kSharpness * footprint, 1e-6F));
  // The long axis grows with z^2, the short one with z.
  level_per_log2z_ = longest > 1.5F * shortest ? 2.0F : 1.0F;
  if (num_taps_ > 1) {
    Eigen::Vector2f axis = 0.5F * (outer(0, 0) - outer(1, 1)) > 0
                               ? Eigen::Vector2f(0.5F * (outer(0, 0) - outer(1, 1)) + spread, outer(0, 1))
                               : Eigen::Vector2f(outer(0, 1), 0.5F * (outer(1, 1) - outer(0, 0)) + spread);
    axis *= longest / static_cast<float>(num_taps_) / axis.norm();
    tap_uv_ =
        axis.cwiseQuotient(Eigen::Vector2f(static_cast<float>(texture.width()), static_cast<float>(texture.height())));
  }
}

float SurfacePatch::Brightness(float u, float v) const {
  const LightGrid& light = quad_->light;
  if (light.factors.empty()) return 1;
  const float x = std::clamp(u, 0.0F, 1.0F) * static_cast<float>(light.columns - 1);
  const float y = std::clamp(v, 0.0F, 1.0F) * static_cast<float>(light.rows - 1);
  const int x0 = std::min(static_cast<int>(x), light.columns - 2);
  const int y0 = std::min(static_cast<int>(y), light.rows - 2);
  const float wx = x - static_cast<float>(x0);
  const float wy = y - static_cast<float>(y0);
  const float* top = light.factors.data() + static_cast<ptrdiff_t>(y0) * light.columns + x0;
  const float* bottom = top + light.columns;
  const float above = top[0] + (top[1] - top[0]) * wx;
  const float below = bottom[0] + (bottom[1] - bottom[0]) * wx;
  return above + (below - above) * wy;
}

SurfacePatch::Look SurfacePatch::At(const Eigen::Vector2f& ray) const {
  const Eigen::Vector2f off = ray - ray_;
  const float z = 1.0F / InverseDepth(off);
  const float u = (u_over_z_ + u_slope_.dot(off)) * z;
  const float v = (v_over_z_ + v_slope_.dot(off)) * z;
  const TextureWindow& window = quad_->window;
  const float texture_u = window.u0 + u * (window.u1 - window.u0);
  const float texture_v = window.v0 + v * (window.v1 - window.v0);
  const float level = level_ + level_per_log2z_ * Texture::FastLog2(z * inverse_depth_);
  float gray = 0;
  for (int tap = 0; tap < num_taps_; ++tap) {
    const float steps = static_cast<float>(tap) - 0.5F * static_cast<float>(num_taps_ - 1);
    gray +=
        quad_->texture->SampleLevel(texture_u + steps * tap_uv_.x(), texture_v + steps * tap_uv_.y(), level, beyond_);
  }
  return {gray / static_cast<float>(num_taps_) * Brightness(u, v), z};
}

}  // namespace mapp::sim
