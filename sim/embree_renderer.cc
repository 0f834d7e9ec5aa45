#include "mapp/base/check.h"
#include "mapp/base/mutex.h"
#include "sim/cell_grid.h"
#include "sim/embree_scene.h"
#include "sim/parallel.h"
#include "sim/quad_view.h"
#include "sim/ray_caster.h"
#include "sim/ray_table.h"
#include "sim/renderer.h"

#include <algorithm>
#include <array>
#include <utility>
#include <vector>

// Rays are cast through the corners of cells of 4 x 4 pixels. Most cells show one surface, whose depth and texture
// follow from its plane without further rays. Where surfaces meet, rays go through the centre and the corners of each
// pixel, and a pixel that sees several surfaces blends them.

namespace mapp::sim {
namespace {

constexpr int kCell_px = CellGrid::kCell_px;
static_assert(kCell_px <= SurfacePatch::kMaxRays);

/// The appearance of the few views seen within a cell.
class CellPatches {
 public:
  CellPatches(const std::vector<QuadView>& views, const Eigen::Vector2f& ray_per_x, const Eigen::Vector2f& ray_per_y)
      : views_(views), ray_per_x_(ray_per_x), ray_per_y_(ray_per_y) {}

  /// `ray` must meet the view.
  const SurfacePatch& Of(int32_t view, const Eigen::Vector2f& ray) {
    for (size_t i = 0; i < num_known_; ++i) {
      if (known_[i].first == view) return known_[i].second;
    }
    const size_t slot = num_known_ < known_.size() ? num_known_++ : known_.size() - 1;
    known_[slot] = {view, SurfacePatch(views_[static_cast<size_t>(view)], ray, ray_per_x_, ray_per_y_)};
    return known_[slot].second;
  }

 private:
  const std::vector<QuadView>& views_;
  const Eigen::Vector2f ray_per_x_;
  const Eigen::Vector2f ray_per_y_;
  std::array<std::pair<int32_t, SurfacePatch>, 6> known_;
  size_t num_known_ = 0;
};

/// One picture in the making.
class Drawing {
 public:
  Drawing(const RayTable& rays, const RayCaster& caster, const EmbreeOptions& options)
      : rays_(rays), caster_(caster), options_(options), grid_(rays) {
    frame_.gray = GrayImage(rays.width(), rays.height());
    frame_.depth_m = DepthImage(rays.width(), rays.height());
    if (options.with_color) frame_.color = ColorImage(rays.width(), rays.height());
  }

  RenderedFrame Draw() {
    constexpr int kViewsAtOnce = 32;
    const int num_views = static_cast<int>(caster_.views().size());
    ParallelFor(options_.num_threads, grid_.rows() + 1, [&](int line) { CastCorners(line); });
    ParallelFor(options_.num_threads, (num_views + kViewsAtOnce - 1) / kViewsAtOnce, [&](int chunk) {
      const int end = std::min((chunk + 1) * kViewsAtOnce, num_views);
      for (int view = chunk * kViewsAtOnce; view < end; ++view) grid_.MarkEdges(caster_.views(), view);
    });
    ParallelFor(options_.num_threads, grid_.rows(), [&](int row) {
      for (int column = 0; column < grid_.columns(); ++column) DrawCell(column, row);
    });
    return std::move(frame_);
  }

 private:
  struct Cell {
    int x0 = 0, y0 = 0, x1 = 0, y1 = 0;  ///< pixels [x0, x1) x [y0, y1)
  };

  void CastCorners(int line) {
    const size_t count = static_cast<size_t>(grid_.columns()) + 1;
    std::vector<Eigen::Vector2f> rays(count);
    for (size_t i = 0; i < count; ++i) rays[i] = rays_.Corner(grid_.FirstX(static_cast<int>(i)), grid_.FirstY(line));
    caster_.Cast(rays, {grid_.CornerViews(line), count});
  }

  void DrawCell(int column, int row) {
    const Cell cell{grid_.FirstX(column), grid_.FirstY(row), grid_.FirstX(column + 1), grid_.FirstY(row + 1)};
    const Eigen::Vector2f& corner = rays_.Corner(cell.x0, cell.y0);
    CellPatches patches(caster_.views(), rays_.Corner(cell.x0 + 1, cell.y0) - corner,
                        rays_.Corner(cell.x0, cell.y0 + 1) - corner);
    if (grid_.IsPlain(column, row)) {
      DrawPlain(cell, grid_.CornerViews(row)[column], patches);
    } else {
      DrawMixed(cell, grid_.CornersAgree(column, row), grid_.CornerViews(row)[column], patches);
    }
  }

  void DrawPlain(const Cell& cell, int32_t view, CellPatches& patches) {
    if (view == kNoView) return DrawSky(cell);
    const SurfacePatch& patch = patches.Of(view, rays_.Center((cell.x0 + cell.x1) / 2, (cell.y0 + cell.y1) / 2));
    const int width = cell.x1 - cell.x0;
    std::array<float, kCell_px> gray;
    std::array<float, kCell_px> depth_m;
    for (int y = cell.y0; y < cell.y1; ++y) {
      patch.LookAt(&rays_.Center(cell.x0, y), width, gray.data(), depth_m.data());
      for (int i = 0; i < width; ++i) {
        const auto at = static_cast<size_t>(i);
        SetPixel(cell.x0 + i, y, gray[at], depth_m[at], gray[at] * patch.tint_rgb());
      }
    }
  }

  void DrawSky(const Cell& cell) {
    for (int y = cell.y0; y < cell.y1; ++y) {
      for (int x = cell.x0; x < cell.x1; ++x) SetPixel(x, y, Sky(), 0, Eigen::Vector3f::Constant(Sky()));
    }
  }

  /// Rays through all centres and corners of a cell's pixels, and what they see; row by row, centres first.
  struct PixelRays {
    static constexpr size_t kMaxCenters = kCell_px * kCell_px;
    static constexpr size_t kMaxCorners = (kCell_px + 1) * (kCell_px + 1);
    std::array<Eigen::Vector2f, kMaxCenters + kMaxCorners> rays;
    std::array<int32_t, kMaxCenters + kMaxCorners> views;
    size_t num_centers = 0;
    int width = 0;

    size_t CenterIndex(int x, int y) const { return static_cast<size_t>(y * width + x); }
    size_t CornerIndex(int x, int y) const { return num_centers + static_cast<size_t>(y * (width + 1) + x); }
  };

  void CastCenters(const Cell& cell, PixelRays& pixels) const {
    pixels.width = cell.x1 - cell.x0;
    for (int y = cell.y0; y < cell.y1; ++y) {
      for (int x = cell.x0; x < cell.x1; ++x) pixels.rays[pixels.num_centers++] = rays_.Center(x, y);
    }
    caster_.Cast({pixels.rays.data(), pixels.num_centers}, {pixels.views.data(), pixels.num_centers});
  }

  void CastPixelCorners(const Cell& cell, PixelRays& pixels) const {
    size_t next = pixels.num_centers;
    for (int y = cell.y0; y <= cell.y1; ++y) {
      for (int x = cell.x0; x <= cell.x1; ++x) pixels.rays[next++] = rays_.Corner(x, y);
    }
    const size_t count = next - pixels.num_centers;
    caster_.Cast({&pixels.rays[pixels.num_centers], count}, {&pixels.views[pixels.num_centers], count});
  }

  /// A cell that may show several views; its top left corner sees `corner_view`, and the others the same if
  /// `corners_agree`.
  void DrawMixed(const Cell& cell, bool corners_agree, int32_t corner_view, CellPatches& patches) {
    PixelRays pixels;
    CastCenters(cell, pixels);
    // Cells are suspected with some margin: most have an edge near them, not in them.
    const bool all_agree = corners_agree && std::all_of(pixels.views.begin(), pixels.views.begin() + pixels.num_centers,
                                                        [&](int32_t view) { return view == corner_view; });
    if (all_agree) return DrawPlain(cell, corner_view, patches);
    CastPixelCorners(cell, pixels);
    for (int y = cell.y0; y < cell.y1; ++y) {
      for (int x = cell.x0; x < cell.x1; ++x) {
        const int cell_x = x - cell.x0;
        const int cell_y = y - cell.y0;
        DrawPixel(x, y, pixels,
                  {pixels.CenterIndex(cell_x, cell_y), pixels.CornerIndex(cell_x, cell_y),
                   pixels.CornerIndex(cell_x + 1, cell_y), pixels.CornerIndex(cell_x, cell_y + 1),
                   pixels.CornerIndex(cell_x + 1, cell_y + 1)},
                  patches);
      }
    }
  }

  /// Blends what the samples see; the centre counts for half of the pixel, the corners, which four pixels share, for an
  /// eighth each. Depth is the centre's.
  void DrawPixel(int x, int y, const PixelRays& pixels, const std::array<size_t, 5>& samples, CellPatches& patches) {
    constexpr std::array<float, 5> kWeights = {0.5F, 0.125F, 0.125F, 0.125F, 0.125F};
    const int32_t center_view = pixels.views[samples[0]];
    const Eigen::Vector2f& center = pixels.rays[samples[0]];
    float gray = 0;
    Eigen::Vector3f color = Eigen::Vector3f::Zero();
    std::array<bool, 5> done{};
    for (size_t i = 0; i < samples.size(); ++i) {
      if (done[i]) continue;
      const int32_t view = pixels.views[samples[i]];
      // Samples of one surface are looked up once, in their middle, which the surface covers as it is convex.
      float weight = 0;
      Eigen::Vector2f middle = Eigen::Vector2f::Zero();
      for (size_t j = i; j < samples.size(); ++j) {
        if (pixels.views[samples[j]] != view) continue;
        done[j] = true;
        weight += kWeights[j];
        middle += kWeights[j] * pixels.rays[samples[j]];
      }
      if (view == kNoView) {
        gray += weight * Sky();
        color.array() += weight * Sky();
        continue;
      }
      const SurfacePatch& patch = patches.Of(view, pixels.rays[samples[i]]);
      const float level = weight * patch.GrayAt(middle / weight);
      gray += level;
      color += level * patch.tint_rgb();
    }
    SetPixel(x, y, gray, center_view == kNoView ? 0 : patches.Of(center_view, center).DepthAt(center), color);
  }

  void SetPixel(int x, int y, float gray, float depth_m, const Eigen::Vector3f& color) {
    const auto to_level = [](float level) { return static_cast<uint8_t>(std::clamp(level + 0.5F, 0.0F, 255.0F)); };
    frame_.gray.at(x, y) = to_level(gray);
    frame_.depth_m.at(x, y) = depth_m;
    if (options_.with_color) frame_.color.at(x, y) = {to_level(color.x()), to_level(color.y()), to_level(color.z())};
  }

  float Sky() const { return static_cast<float>(options_.sky_gray); }

  const RayTable& rays_;
  const RayCaster& caster_;
  const EmbreeOptions& options_;
  CellGrid grid_;
  RenderedFrame frame_;
};

class EmbreeRenderer final : public Renderer {
 public:
  EmbreeRenderer(std::shared_ptr<const Scene> scene, const EmbreeOptions& options)
      : scene_(std::move(scene)), embree_(scene_->quads, 0, EmbreeScene::Lifetime::kLong), options_(options) {
    for (const Quad& quad : scene_->quads) {
      MAPP_CHECK(quad.light.factors.empty() || (quad.light.columns >= 2 && quad.light.rows >= 2));
    }
  }

  StatusOr<RenderedFrame> Render(const Camera& camera, const Pose3& T_world_camera,
                                 std::span<const Quad> moving_quads) const override {
    MAPP_RETURN_IF_ERROR(camera.Validate());
    const std::shared_ptr<const RayTable> rays = RaysOf(camera);
    const RayCaster caster(embree_, scene_->quads, moving_quads, rays->bounds(), T_world_camera);
    return Drawing(*rays, caster, options_).Draw();
  }

 private:
  /// A renderer serves the cameras of a few devices, so tables are kept.
  std::shared_ptr<const RayTable> RaysOf(const Camera& camera) const {
    const auto is_same = [&](const Camera& other) {
      return other.width_px == camera.width_px && other.height_px == camera.height_px &&
             ModelName(other.projection) == ModelName(camera.projection) &&
             Coefficients(other.projection) == Coefficients(camera.projection);
    };
    const MutexLock lock(mutex_);
    for (const auto& table : tables_) {
      if (is_same(table->camera())) return table;
    }
    tables_.push_back(std::make_shared<const RayTable>(camera));
    return tables_.back();
  }

  const std::shared_ptr<const Scene> scene_;
  const EmbreeScene embree_;
  const EmbreeOptions options_;
  mutable Mutex mutex_;
  mutable std::vector<std::shared_ptr<const RayTable>> tables_ ABSL_GUARDED_BY(mutex_);
};

}  // namespace

std::unique_ptr<Renderer> MakeEmbreeRenderer(std::shared_ptr<const Scene> scene, const EmbreeOptions& options) {
  MAPP_CHECK(scene != nullptr && options.num_threads >= 1 && options.num_threads <= 256);
  return std::make_unique<EmbreeRenderer>(std::move(scene), options);
}

}  // namespace mapp::sim
