#include "mapp/base/check.h"
#include "mapp/base/mutex.h"
#include "sim/cell_grid.h"
#include "sim/cell_samples.h"
#include "sim/embree_scene.h"
#include "sim/four.h"
#include "mapp/base/parallel.h"
#include "sim/ray_caster.h"
#include "sim/ray_table.h"
#include "sim/renderer.h"

#include <algorithm>
#include <array>
#include <cstring>
#include <utility>
#include <vector>

// Rays are cast through the corners of cells of 4 x 4 pixels. Most cells show one surface, whose depth and texture
// follow from its plane without further rays. Where surfaces meet, those whose edges pass there tell by their planes
// and borders which is seen, and a pixel that shows several blends them; only crowded cells need more rays. Four pixels
// side by side are drawn at once.

namespace mapp::sim {
namespace {

constexpr int kCell_px = CellGrid::kCell_px;

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
    ParallelFor(options_.num_threads, grid_.num_bands(),
                [&](int band) { grid_.CompareCorners(caster_.views(), band); });
    ParallelFor(options_.num_threads, (num_views + kViewsAtOnce - 1) / kViewsAtOnce, [&](int chunk) {
      const int end = std::min((chunk + 1) * kViewsAtOnce, num_views);
      for (int view = chunk * kViewsAtOnce; view < end; ++view) grid_.MarkEdges(caster_.views(), view);
    });
    ParallelFor(options_.num_threads, grid_.rows(), [&](int row) {
      RowState state{CellSamples(rays_, caster_), {}};
      for (int column = 0; column < grid_.columns(); ++column) DrawCell(column, row, state);
    });
    return std::move(frame_);
  }

 private:
  struct Cell {
    int x0 = 0, y0 = 0, x1 = 0, y1 = 0;  ///< pixels [x0, x1) x [y0, y1)
  };

  /// What the cells of a row hand on to each other.
  struct RowState {
    CellSamples samples;
    /// Of the last plain cells; neighbours that show the same surface share it.
    struct {
      int32_t view = kNoView;
      int until_x = 0;
      SurfacePatch patch;
    } plain;
  };

  void CastCorners(int line) {
    const size_t count = static_cast<size_t>(grid_.columns()) + 1;
    std::vector<Eigen::Vector2f> rays(count);
    for (size_t i = 0; i < count; ++i) rays[i] = rays_.Corner(grid_.FirstX(static_cast<int>(i)), grid_.FirstY(line));
    caster_.Cast(rays, {grid_.CornerViews(line), count});
  }

  void DrawCell(int column, int row, RowState& state) {
    const Cell cell{grid_.FirstX(column), grid_.FirstY(row), grid_.FirstX(column + 1), grid_.FirstY(row + 1)};
    const int32_t* top = grid_.CornerViews(row) + column;
    if (grid_.IsPlain(column, row)) return DrawPlain(cell, top[0], state);
    CellSamples& samples = state.samples;
    samples.Begin(cell.x0, cell.y0);
    if (const auto candidates = grid_.CandidatesOf(column, row)) {
      samples.Resolve(*candidates);
    } else {
      samples.Cast();
    }
    // Edges mark cells with some margin: some have one near them, not in them.
    if (const std::optional<int32_t> view = samples.OnlyView()) return DrawPlain(cell, *view, state);
    std::array<Strip, kCell_px> strips;
    for (int slot = CellSamples::kSky; slot < samples.num_slots(); ++slot) AddSlot(cell, samples, slot, strips);
    for (int y = cell.y0; y < cell.y1; ++y) Store(strips[static_cast<size_t>(y - cell.y0)], cell, y);
  }

  Eigen::Vector2f RayPerX(const Cell& cell) const {
    return rays_.Corner(cell.x0 + 1, cell.y0) - rays_.Corner(cell.x0, cell.y0);
  }
  Eigen::Vector2f RayPerY(const Cell& cell) const {
    return rays_.Corner(cell.x0, cell.y0 + 1) - rays_.Corner(cell.x0, cell.y0);
  }

  void DrawPlain(const Cell& cell, int32_t view, RowState& state) {
    if (view == kNoView) return DrawSky(cell);
    auto& plain = state.plain;
    if (plain.view != view || cell.x0 >= plain.until_x) {
      constexpr int kCellsShared = 4;
      plain.view = view;
      plain.until_x = cell.x0 + kCellsShared * kCell_px;
      plain.patch =
          SurfacePatch(caster_.views()[static_cast<size_t>(view)],
                       rays_.Center((cell.x0 + cell.x1) / 2, (cell.y0 + cell.y1) / 2), RayPerX(cell), RayPerY(cell));
    }
    std::array<RayRow, kCell_px> rays;
    for (int i = 0; i < kCell_px; ++i) rays[i] = rays_.CenterRow(cell.x0, std::min(cell.y0 + i, rays_.height() - 1));
    const SurfacePatch::Look look = plain.patch.LookAt(rays);
    for (int y = cell.y0; y < cell.y1; ++y) {
      const auto line = static_cast<size_t>(y - cell.y0);
      Strip strip;
      Add(look.gray[line], plain.patch.tint_rgb(), strip);
      strip.depth_m = look.depth_m[line];
      Store(strip, cell, y);
    }
  }

  void DrawSky(const Cell& cell) {
    Strip strip;
    AddSky(Eigen::Array4f::Ones(), strip);
    for (int y = cell.y0; y < cell.y1; ++y) Store(strip, cell, y);
  }

  /// Levels and depths of four pixels.
  struct Strip {
    Eigen::Array4f gray = Eigen::Array4f::Zero();
    Eigen::Array4f depth_m = Eigen::Array4f::Zero();
    std::array<Eigen::Array4f, 3> color = {gray, gray, gray};
  };

  /// What one of the surfaces of a cell adds to it. They are blended as the samples see them: the centre counts for
  /// half of the pixel, the corners, which four pixels share, for an eighth each. Depth is the centre's.
  void AddSlot(const Cell& cell, const CellSamples& samples, int slot, std::array<Strip, kCell_px>& strips) const {
    SurfacePatch patch;
    if (slot != CellSamples::kSky) {
      const CellSamples::Seen seen = samples.At(slot);
      if (!seen.ray) return;
      patch = SurfacePatch(caster_.views()[static_cast<size_t>(seen.view)], *seen.ray, RayPerX(cell), RayPerY(cell));
    }
    const auto number = static_cast<float>(slot);
    for (int line = 0; line < kCell_px; ++line) {
      const CellSamples::Row centers = samples.Centers(line);
      const Int4 at_center = AreEqual(centers.slots, number);
      Eigen::Array4f weight = Masked(at_center, Eigen::Array4f::Constant(0.5F));
      // Samples of one surface are looked up once, in their middle, which the surface covers as it is convex.
      RayRow middle{weight * centers.rays.x, weight * centers.rays.y};
      for (const int below : {0, 1}) {
        for (const int right : {0, 1}) {
          const CellSamples::Row corner = samples.Corners(line + below, right);
          const Eigen::Array4f share = Masked(AreEqual(corner.slots, number), Eigen::Array4f::Constant(0.125F));
          weight += share;
          middle.x += share * corner.rays.x;
          middle.y += share * corner.rays.y;
        }
      }
      const Int4 is_seen = AreGreater(weight, Eigen::Array4f::Zero());
      if (!IsAnySet(is_seen)) continue;
      Strip& strip = strips[static_cast<size_t>(line)];
      if (slot == CellSamples::kSky) {
        AddSky(weight, strip);
        continue;
      }
      // Pixels that do not show the surface look where it surely is.
      const Eigen::Array4f scale = weight.max(0.125F).inverse();
      middle.x = Select(is_seen, middle.x * scale, Eigen::Array4f::Constant(patch.ray().x()));
      middle.y = Select(is_seen, middle.y * scale, Eigen::Array4f::Constant(patch.ray().y()));
      Add(weight * patch.GrayAt(middle), patch.tint_rgb(), strip);
      const Eigen::Array4f inverse_depth = patch.InverseDepthOf(centers.rays);
      strip.depth_m = Select(at_center, inverse_depth.inverse(), strip.depth_m);
    }
  }

  void Add(const Eigen::Array4f& level, const Eigen::Vector3f& tint_rgb, Strip& strip) const {
    strip.gray += level;
    if (!options_.with_color) return;
    for (size_t i = 0; i < strip.color.size(); ++i) strip.color[i] += level * tint_rgb[static_cast<Eigen::Index>(i)];
  }
  void AddSky(const Eigen::Array4f& weight, Strip& strip) const { Add(weight * Sky(), Eigen::Vector3f::Ones(), strip); }

  void Store(const Strip& strip, const Cell& cell, int y) {
    const auto count = static_cast<size_t>(cell.x1 - cell.x0);
    const size_t first = static_cast<size_t>(y) * static_cast<size_t>(rays_.width()) + static_cast<size_t>(cell.x0);
    const std::array<uint8_t, kCell_px> gray = ToLevels(strip.gray);
    if (count == kCell_px) {
      std::memcpy(&frame_.gray.pixels[first], gray.data(), gray.size());
      Eigen::Map<Eigen::Array4f>(&frame_.depth_m.pixels[first]) = strip.depth_m;
    } else {
      std::copy_n(gray.begin(), count, &frame_.gray.pixels[first]);
      std::copy_n(strip.depth_m.data(), count, &frame_.depth_m.pixels[first]);
    }
    if (!options_.with_color) return;
    for (size_t i = 0; i < strip.color.size(); ++i) {
      const std::array<uint8_t, kCell_px> levels = ToLevels(strip.color[i]);
      for (size_t x = 0; x < count; ++x) frame_.color.pixels[first + x][i] = levels[x];
    }
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
