#include "sim/quad_view.h"

#include <Eigen/Geometry>

#include <algorithm>
#include <cmath>

namespace mapp::sim {
namespace {

/// Surfaces seen at a flat angle are looked up at several places along the pixel's long axis; beyond that many the
/// picture is blurred.
constexpr int kMaxTaps = 2;
/// Each of them may be this much longer than wide: linear blending reaches further than a box.
constexpr float kStretch = 1.6F;
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
      texture_(view.quad->texture.get()),
      ray_(ray),
      beyond_(Repeats(view.quad->window) ? Texture::Beyond::kRepeat : Texture::Beyond::kClamp) {
  const TextureWindow& window = quad_->window;
  inverse_depth_ = RayLinear(view.inverse_depth, ray);
  u_over_z_ = RayLinear(view.u_over_z, ray);
  v_over_z_ = RayLinear(view.v_over_z, ray);
  texture_u_over_z_ = RayLinear(window.u0 * view.inverse_depth + (window.u1 - window.u0) * view.u_over_z, ray);
  texture_v_over_z_ = RayLinear(window.v0 * view.inverse_depth + (window.v1 - window.v0) * view.v_over_z, ray);
  depth_m_ = 1.0F / inverse_depth_.at_ray;
  ChooseLookup(ray_per_x, ray_per_y);
}

void SurfacePatch::ChooseLookup(const Eigen::Vector2f& ray_per_x, const Eigen::Vector2f& ray_per_y) {
  // The pixel's two axes on the texture, in texels per pixel, by the quotient rule.
  const Eigen::Vector2f size(static_cast<float>(texture_->width()), static_cast<float>(texture_->height()));
  const Eigen::Vector2f uv = depth_m_ * Eigen::Vector2f(texture_u_over_z_.at_ray, texture_v_over_z_.at_ray);
  const auto on_texture = [&](const Eigen::Vector2f& step) {
    const auto along = [&](const RayLinear& f) { return f.per_x * step.x() + f.per_y * step.y(); };
    const Eigen::Vector2f over_z(along(texture_u_over_z_), along(texture_v_over_z_));
    return Eigen::Vector2f(depth_m_ * (over_z - uv * along(inverse_depth_)).cwiseProduct(size));
  };
  // The footprint's true shape, whichever way it lies: singular values and long axis of the Jacobian (x, y).
  const Eigen::Vector2f x = on_texture(ray_per_x);
  const Eigen::Vector2f y = on_texture(ray_per_y);
  const float uu = x.x() * x.x() + y.x() * y.x();
  const float vv = x.y() * x.y() + y.y() * y.y();
  const float uv_product = x.x() * x.y() + y.x() * y.y();
  const float mean = 0.5F * (uu + vv);
  const float half = 0.5F * (uu - vv);
  const float spread = std::sqrt(half * half + uv_product * uv_product);
  const float longest = std::sqrt(mean + spread);
  const float shortest = std::sqrt(std::max(mean - spread, 0.0F));
  num_taps_ = std::clamp(static_cast<int>(longest / (kStretch * std::max(shortest, 1.0F)) + 0.5F), 1, kMaxTaps);
  const float tap_length = longest / static_cast<float>(num_taps_);
  const float footprint = std::max(shortest, tap_length / kStretch);
  level_ = Texture::FastLog2(std::max(kSharpness * footprint, 1e-6F));
  // The long axis grows with z^2, the short one with z.
  level_per_log2z_ = longest > kStretch * shortest ? 2.0F : 1.0F;
  if (num_taps_ == 1) return;
  Eigen::Vector2f axis =
      half > 0 ? Eigen::Vector2f(half + spread, uv_product) : Eigen::Vector2f(uv_product, spread - half);
  axis *= tap_length / axis.norm();
  tap_uv_ = axis.cwiseQuotient(size);
}

Texture::Slice SurfacePatch::SliceAt(float depth_m) const {
  const float level = level_ + level_per_log2z_ * Texture::FastLog2(depth_m * inverse_depth_.at_ray);
  return texture_->AtLevel(level, beyond_);
}

inline Eigen::Array4f SurfacePatch::Texels(const RayRow& off, const Eigen::Array4f& depth_m,
                                           const Texture::Slice& slice) const {
  const Eigen::Array4f u = texture_u_over_z_(off) * depth_m;
  const Eigen::Array4f v = texture_v_over_z_(off) * depth_m;
  if (num_taps_ == 1) return slice.At(u, v);
  static_assert(kMaxTaps == 2);
  const Eigen::Vector2f half = 0.5F * tap_uv_;
  return 0.5F * (slice.At(u - half.x(), v - half.y()) + slice.At(u + half.x(), v + half.y()));
}

inline Eigen::Array4f SurfacePatch::Brightness(const RayRow& off, const Eigen::Array4f& depth_m) const {
  const LightGrid& light = quad_->light;
  const Eigen::Array4f u = u_over_z_(off) * depth_m;
  const Eigen::Array4f v = v_over_z_(off) * depth_m;
  const Eigen::Array4f x = u.max(0.0F).min(1.0F) * static_cast<float>(light.columns - 1);
  const Eigen::Array4f y = v.max(0.0F).min(1.0F) * static_cast<float>(light.rows - 1);
  const Eigen::Array4f x0 = ToFloat(Truncate(x)).min(static_cast<float>(light.columns - 2));
  const Eigen::Array4f y0 = ToFloat(Truncate(y)).min(static_cast<float>(light.rows - 2));
  const Int4 offsets = Truncate(y0) * light.columns + Truncate(x0);
  Eigen::Array4f top_left, top_right, bottom_left, bottom_right;
  for (int i = 0; i < RayRow::kSize; ++i) {
    const float* top = light.factors.data() + offsets[i];
    const float* bottom = top + light.columns;
    top_left[i] = top[0];
    top_right[i] = top[1];
    bottom_left[i] = bottom[0];
    bottom_right[i] = bottom[1];
  }
  const Eigen::Array4f wx = x - x0;
  const Eigen::Array4f above = top_left + (top_right - top_left) * wx;
  const Eigen::Array4f below = bottom_left + (bottom_right - bottom_left) * wx;
  return above + (below - above) * (y - y0);
}

[[gnu::flatten]] Eigen::Array4f SurfacePatch::GrayAt(const RayRow& rays) const {
  const RayRow off = OffOf(rays);
  const Eigen::Array4f depth_m = inverse_depth_(off).inverse();
  const Eigen::Array4f texels = Texels(off, depth_m, SliceAt(depth_m[1]));
  return quad_->light.factors.empty() ? texels : texels * Brightness(off, depth_m);
}

// Flat: what is the same for all pixels of a cell is then computed once.
[[gnu::flatten]] SurfacePatch::Look SurfacePatch::LookAt(const std::array<RayRow, RayRow::kSize>& rays) const {
  constexpr int kLast = RayRow::kSize - 1;
  std::array<RayRow, RayRow::kSize> offs;
  Look look;
  for (size_t i = 0; i < rays.size(); ++i) {
    offs[i] = OffOf(rays[i]);
    look.depth_m[i] = inverse_depth_(offs[i]).inverse();
  }
  // The cell's pixels share a mip level: that of one in its middle.
  const Texture::Slice slice = SliceAt(look.depth_m[1][1]);
  for (size_t i = 0; i < rays.size(); ++i) look.gray[i] = Texels(offs[i], look.depth_m[i], slice);
  if (quad_->light.factors.empty()) return look;
  // Light changes so slowly that it is looked up in the cell's corners and blended between.
  const auto corners = [](const auto& top, const auto& bottom) {
    return Eigen::Array4f(top[0], bottom[0], top[kLast], bottom[kLast]);
  };
  const RayRow corner_offs{corners(offs.front().x, offs.back().x), corners(offs.front().y, offs.back().y)};
  const Eigen::Array4f factors = Brightness(corner_offs, corners(look.depth_m.front(), look.depth_m.back()));
  const Eigen::Array4f along(0, 1.0F / kLast, 2.0F / kLast, 1);
  const Eigen::Array4f top = factors[0] + (factors[2] - factors[0]) * along;
  const Eigen::Array4f step = (factors[1] + (factors[3] - factors[1]) * along - top) / kLast;
  for (size_t i = 0; i < rays.size(); ++i) look.gray[i] *= top + static_cast<float>(i) * step;
  return look;
}

}  // namespace mapp::sim
