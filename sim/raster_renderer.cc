#include "mapp/base/check.h"
#include "sim/renderer.h"

#include <Eigen/Dense>
#include <fmt/format.h>

#include <algorithm>
#include <array>
#include <atomic>
#include <cmath>
#include <limits>
#include <optional>
#include <thread>
#include <utility>
#include <vector>

// A rectangle's inverse depth 1/z, u/z and v/z are affine in the pixel (Blinn 1992, "Hyperbolic interpolation"), so a
// row of it costs three additions a sample and the picture is exact.

namespace mapp::sim {
namespace {

constexpr int kSamplesPerEdge = 2;  // per pixel
constexpr int kNumSamples = kSamplesPerEdge * kSamplesPerEdge;
constexpr int kBandRows = 16;  // pixel rows whose buffers stay in the L2 cache
constexpr double kNearPlane_m = 0.02;
constexpr uint16_t kNothing = std::numeric_limits<uint16_t>::max();
/// Isotropic mip levels blur surfaces seen at a flat angle; the footprint is narrowed to at most this share.
constexpr float kMaxAnisotropy = 4.0F;
/// A mip level is already a box filter; blending two of them over the whole pixel would blur twice.
constexpr float kSharpness = 0.7F;

/// Affine function of the sample position, in samples.
struct Affine {
  double at_origin = 0;
  double per_x = 0;
  double per_y = 0;
  double operator()(double x, double y) const { return at_origin + per_x * x + per_y * y; }
};

/// A rectangle as one camera sees it. x and y count samples from the centre of the top left one.
struct ScreenQuad {
  const Texture* texture = nullptr;
  Affine inverse_depth;
  Affine u_over_z;
  Affine v_over_z;
  std::vector<Eigen::Vector2d> outline;  ///< convex
  double min_y = 0;
  double max_y = 0;
};

/// The part of a polygon in front of the near plane (Sutherland and Hodgman 1974).
std::vector<Eigen::Vector3d> ClipToNearPlane(const std::vector<Eigen::Vector3d>& polygon_camera) {
  std::vector<Eigen::Vector3d> clipped;
  for (size_t i = 0; i < polygon_camera.size(); ++i) {
    const Eigen::Vector3d& a = polygon_camera[i];
    const Eigen::Vector3d& b = polygon_camera[(i + 1) % polygon_camera.size()];
    if (a.z() >= kNearPlane_m) clipped.push_back(a);
    if ((a.z() >= kNearPlane_m) != (b.z() >= kNearPlane_m)) {
      clipped.push_back(a + (b - a) * ((kNearPlane_m - a.z()) / (b.z() - a.z())));
    }
  }
  return clipped;
}

class FrameProjection {
 public:
  FrameProjection(const PinholeCamera& camera, const Pose3& T_world_camera)
      : camera_(camera), T_camera_world_(T_world_camera.Inverse()) {}

  /// Nullopt for a rectangle that shows its back or lies behind the camera.
  std::optional<ScreenQuad> Project(const Quad& quad) const {
    const Eigen::Vector3d corner = T_camera_world_ * quad.corner_world;
    const Eigen::Vector3d edge_u = T_camera_world_.rotation() * quad.edge_u_world;
    const Eigen::Vector3d edge_v = T_camera_world_.rotation() * quad.edge_v_world;
    const Eigen::Vector3d normal = edge_v.cross(edge_u).normalized();
    const double offset_m = normal.dot(corner);  // negative when the camera is in front
    if (offset_m >= -1e-9) return std::nullopt;

    const auto clipped = ClipToNearPlane({corner, corner + edge_u, corner + edge_u + edge_v, corner + edge_v});
    if (clipped.size() < 3) return std::nullopt;
    ScreenQuad screen;
    screen.texture = quad.texture.get();
    for (const Eigen::Vector3d& p_camera : clipped) screen.outline.push_back(ToSamples(camera_.Project(p_camera)));
    const auto [lowest, highest] =
        std::minmax_element(screen.outline.begin(), screen.outline.end(),
                            [](const Eigen::Vector2d& a, const Eigen::Vector2d& b) { return a.y() < b.y(); });
    screen.min_y = lowest->y();
    screen.max_y = highest->y();
    // With the ray d (d.z = 1): 1/z = n.d / offset and u = eu.(z d - corner) / |eu|^2, likewise v.
    const Eigen::Vector3d inverse_depth = normal / offset_m;
    const Eigen::Vector3d dual_u = edge_u / edge_u.squaredNorm();
    const Eigen::Vector3d dual_v = edge_v / edge_v.squaredNorm();
    screen.inverse_depth = OnSamples(inverse_depth);
    screen.u_over_z = OnSamples(dual_u - dual_u.dot(corner) * inverse_depth);
    screen.v_over_z = OnSamples(dual_v - dual_v.dot(corner) * inverse_depth);
    return screen;
  }

 private:
  static Eigen::Vector2d ToSamples(const Eigen::Vector2d& pixel) {
    return (pixel.array() + 0.5) * kSamplesPerEdge - 0.5;
  }
  /// The function coefficients . d of the ray d as a function of the sample.
  Affine OnSamples(const Eigen::Vector3d& coefficients) const {
    const double first_px = 0.5 / kSamplesPerEdge - 0.5;  // position of sample 0 in pixels
    return {coefficients.dot(camera_.Unproject({first_px, first_px})),
            coefficients.x() / (camera_.fx * kSamplesPerEdge), coefficients.y() / (camera_.fy * kSamplesPerEdge)};
  }

  const PinholeCamera camera_;
  const Pose3 T_camera_world_;
};

/// Where the row y crosses a convex outline; first > second if it does not.
std::pair<double, double> CrossRow(const std::vector<Eigen::Vector2d>& outline, double y) {
  std::pair<double, double> span{std::numeric_limits<double>::infinity(), -std::numeric_limits<double>::infinity()};
  for (size_t i = 0; i < outline.size(); ++i) {
    const Eigen::Vector2d& a = outline[i];
    const Eigen::Vector2d& b = outline[(i + 1) % outline.size()];
    if ((a.y() <= y) == (b.y() <= y)) continue;
    const double x = a.x() + (b.x() - a.x()) * (y - a.y()) / (b.y() - a.y());
    span.first = std::min(span.first, x);
    span.second = std::max(span.second, x);
  }
  return span;
}

/// Draws bands of rows of one frame; one object a thread.
class BandPainter {
 public:
  BandPainter(const std::vector<ScreenQuad>& visible, RenderedFrame& frame)
      : visible_(visible),
        frame_(frame),
        samples_per_row_(frame.gray.width * kSamplesPerEdge),
        inverse_depth_(static_cast<size_t>(samples_per_row_ * kBandRows * kSamplesPerEdge)),
        nearest_(inverse_depth_.size()) {}

  void Draw(int first_row) {
    const int num_rows = std::min(kBandRows, frame_.gray.height - first_row);
    const int first_y = first_row * kSamplesPerEdge;
    const int num_y = num_rows * kSamplesPerEdge;
    std::fill(inverse_depth_.begin(), inverse_depth_.end(), 0.0F);
    std::fill(nearest_.begin(), nearest_.end(), kNothing);
    for (size_t i = 0; i < visible_.size(); ++i) Cover(static_cast<uint16_t>(i), first_y, num_y);
    for (int row = 0; row < num_rows; ++row) Resolve(row, first_row + row);
  }

 private:
  size_t RowStart(int y) const { return static_cast<size_t>(y) * static_cast<size_t>(samples_per_row_); }

  /// Marks the samples at which a rectangle is the nearest so far.
  void Cover(uint16_t visible_idx, int first_y, int num_y) {
    const ScreenQuad& screen = visible_[visible_idx];
    const int begin_y = static_cast<int>(std::clamp(std::ceil(screen.min_y) - first_y, 0.0, double(num_y)));
    const int end_y = static_cast<int>(std::clamp(std::floor(screen.max_y) - first_y + 1, 0.0, double(num_y)));
    for (int y = begin_y; y < end_y; ++y) {
      const auto [left, right] = CrossRow(screen.outline, first_y + y);
      if (left > right) continue;
      const int begin_x = static_cast<int>(std::clamp(std::ceil(left), 0.0, double(samples_per_row_)));
      const int end_x = static_cast<int>(std::clamp(std::ceil(right), 0.0, double(samples_per_row_)));
      const auto row_value = static_cast<float>(screen.inverse_depth(0, first_y + y));
      const auto step = static_cast<float>(screen.inverse_depth.per_x);
      float* inverse_depth = &inverse_depth_[RowStart(y)];
      uint16_t* nearest = &nearest_[RowStart(y)];
      for (int x = begin_x; x < end_x; ++x) {
        const float value = row_value + step * static_cast<float>(x);
        const bool nearer = value > inverse_depth[x];
        inverse_depth[x] = nearer ? value : inverse_depth[x];
        nearest[x] = nearer ? visible_idx : nearest[x];
      }
    }
  }

  /// Samples to pixels. A pixel inside one surface looks its texture up once, at its centre; at an edge every sample
  /// looks up its own.
  void Resolve(int band_row, int row) {
    for (int column = 0; column < frame_.gray.width; ++column) {
      const PixelSamples samples = SamplesOf(band_row, column);
      const bool inside =
          std::ranges::all_of(samples, [&](const Sample& s) { return s.surface == samples[0].surface; });
      const double x = column * kSamplesPerEdge;
      const double y = row * kSamplesPerEdge;
      float level = 0;
      float inverse_depth = 0;
      if (inside) {
        constexpr double kToCenter = 0.5 * (kSamplesPerEdge - 1);
        level = Level(samples[0].surface, x + kToCenter, y + kToCenter, kSamplesPerEdge * kSharpness);
        // Inverse depth is affine, so its mean over one surface is that of the pixel's centre.
        for (const Sample& sample : samples) inverse_depth += sample.inverse_depth / kNumSamples;
      } else {
        for (int i = 0; i < kNumSamples; ++i) {
          const Sample& sample = samples[static_cast<size_t>(i)];
          level += Level(sample.surface, x + i % kSamplesPerEdge, y + i / kSamplesPerEdge, 1.0F) / kNumSamples;
          inverse_depth = std::max(inverse_depth, sample.inverse_depth);
        }
      }
      frame_.gray.at(column, row) = static_cast<uint8_t>(level + 0.5F);
      frame_.depth_m.at(column, row) = inverse_depth > 0 ? 1.0F / inverse_depth : 0.0F;
    }
  }

  struct Sample {
    uint16_t surface = kNothing;
    float inverse_depth = 0;
  };
  using PixelSamples = std::array<Sample, kNumSamples>;

  PixelSamples SamplesOf(int band_row, int column) const {
    PixelSamples samples;
    for (int i = 0; i < kNumSamples; ++i) {
      const size_t index = RowStart(band_row * kSamplesPerEdge + i / kSamplesPerEdge) +
                           static_cast<size_t>(column * kSamplesPerEdge + i % kSamplesPerEdge);
      samples[static_cast<size_t>(i)] = {nearest_[index], inverse_depth_[index]};
    }
    return samples;
  }

  /// Gray level of a surface at a sample position, over a square of `extent` samples an edge.
  float Level(uint16_t visible_idx, double x, double y, float extent) const {
    if (visible_idx == kNothing) return 0;
    const ScreenQuad& screen = visible_[visible_idx];
    const Texture& texture = *screen.texture;
    const auto z = static_cast<float>(1.0 / screen.inverse_depth(x, y));
    const float u = static_cast<float>(screen.u_over_z(x, y)) * z;
    const float v = static_cast<float>(screen.v_over_z(x, y)) * z;
    // Derivatives of the texel position along a row and a column of samples, by the quotient rule.
    const float to_texels_u = z * static_cast<float>(texture.width());
    const float to_texels_v = z * static_cast<float>(texture.height());
    const float du_dx = static_cast<float>(screen.u_over_z.per_x - u * screen.inverse_depth.per_x) * to_texels_u;
    const float du_dy = static_cast<float>(screen.u_over_z.per_y - u * screen.inverse_depth.per_y) * to_texels_u;
    const float dv_dx = static_cast<float>(screen.v_over_z.per_x - v * screen.inverse_depth.per_x) * to_texels_v;
    const float dv_dy = static_cast<float>(screen.v_over_z.per_y - v * screen.inverse_depth.per_y) * to_texels_v;
    const float longest = std::sqrt(std::max(du_dx * du_dx + dv_dx * dv_dx, du_dy * du_dy + dv_dy * dv_dy));
    const float area_edge = std::sqrt(std::abs(du_dx * dv_dy - du_dy * dv_dx));
    return texture.Sample(u, v, extent * std::max(area_edge, longest / kMaxAnisotropy));
  }

  const std::vector<ScreenQuad>& visible_;
  RenderedFrame& frame_;
  const int samples_per_row_;
  std::vector<float> inverse_depth_;  ///< 1/m; 0 = nothing hit
  std::vector<uint16_t> nearest_;     ///< index into visible_, or kNothing
};

class RasterRenderer final : public Renderer {
 public:
  RasterRenderer(std::shared_ptr<const Scene> scene, int num_threads)
      : scene_(std::move(scene)), num_threads_(std::max(num_threads, 1)) {
    MAPP_CHECK(scene_ != nullptr);
  }

  StatusOr<RenderedFrame> Render(const Camera& camera, const Pose3& T_world_camera,
                                 std::span<const Quad> moving_quads) const override {
    MAPP_RETURN_IF_ERROR(camera.Validate());
    const auto* pinhole = std::get_if<PinholeCamera>(&camera.projection);
    if (pinhole == nullptr) {
      return absl::InvalidArgumentError(
          fmt::format("camera.projection: pinhole expected, got {}", ModelName(camera.projection)));
    }
    const FrameProjection projection(*pinhole, T_world_camera);
    std::vector<ScreenQuad> visible;
    for (const std::span<const Quad> quads : {std::span<const Quad>(scene_->quads), moving_quads}) {
      for (const Quad& quad : quads) {
        if (auto screen = projection.Project(quad)) visible.push_back(std::move(*screen));
      }
    }
    MAPP_CHECK(visible.size() < kNothing);
    RenderedFrame frame{GrayImage(camera.width_px, camera.height_px), DepthImage(camera.width_px, camera.height_px)};
    DrawBands(visible, frame);
    return frame;
  }

 private:
  void DrawBands(const std::vector<ScreenQuad>& visible, RenderedFrame& frame) const {
    std::atomic<int> next_row{0};
    const auto draw = [&] {
      BandPainter painter(visible, frame);
      for (int row = next_row.fetch_add(kBandRows); row < frame.gray.height; row = next_row.fetch_add(kBandRows)) {
        painter.Draw(row);
      }
    };
    std::vector<std::jthread> helpers;
    for (int i = 1; i < num_threads_; ++i) helpers.emplace_back(draw);
    draw();
  }

  const std::shared_ptr<const Scene> scene_;
  const int num_threads_;
};

}  // namespace

std::unique_ptr<Renderer> MakeRasterRenderer(std::shared_ptr<const Scene> scene, int num_threads) {
  return std::make_unique<RasterRenderer>(std::move(scene), num_threads);
}

}  // namespace mapp::sim
