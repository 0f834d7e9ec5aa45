#pragma once

#include "sim/cell_grid.h"
#include "sim/quad_view.h"
#include "sim/ray_caster.h"
#include "sim/ray_table.h"

#include <array>
#include <cstdint>
#include <utility>
#include <vector>

namespace mapp::sim {

/// The appearance of the few views seen within a cell, by slot.
class CellSurfaces {
 public:
  /// Of what is not a surface.
  static constexpr int kSky = -1;

  explicit CellSurfaces(const std::vector<QuadView>& views) : views_(views) {}

  /// Starts with the next cell, whose rays change by `ray_per_x` and `ray_per_y` from a pixel to the next.
  void Begin(const Eigen::Vector2f& ray_per_x, const Eigen::Vector2f& ray_per_y);
  /// The slot of a view that `ray` meets, or kSky for kNoView.
  int SlotOf(int32_t view, const Eigen::Vector2f& ray);

  int size() const { return static_cast<int>(known_.size()); }
  const SurfacePatch& operator[](int slot) const { return known_[static_cast<size_t>(slot)].second; }

 private:
  const std::vector<QuadView>& views_;
  Eigen::Vector2f ray_per_x_ = Eigen::Vector2f::Zero();
  Eigen::Vector2f ray_per_y_ = Eigen::Vector2f::Zero();
  std::vector<std::pair<int32_t, SurfacePatch>> known_;
};

/// What the samples of one cell see: the centres of its pixels, and the corners that these share. Rays are cast through
/// the centres; the surfaces they meet tell by their planes and borders what the corners see, which only serve to
/// blend.
class CellSamples {
 public:
  static constexpr int kSize = CellGrid::kCell_px;
  static_assert(kSize == RayRow::kSize);

  CellSamples(const RayTable& rays, const RayCaster& caster) : table_(rays), caster_(caster) {}

  /// Casts rays through the centres of the cell whose top left pixel is (x, y). Returns whether all meet `view`.
  bool AllMeet(int32_t view, int x, int y);
  /// Finds what every sample sees, by slots of `surfaces`, given also what the cell's four corners see. After AllMeet.
  void Resolve(const std::array<int32_t, 4>& corner_views, CellSurfaces& surfaces);

  /// Rays and slots (as numbers) of four samples side by side.
  struct Row {
    RayRow rays;
    Eigen::Array4f slots;
  };
  Row Centers(int line) const { return RowAt(static_cast<size_t>(line * kSize)); }
  /// The corners on line `line` in [0, kSize], from the cell's first or second on.
  Row Corners(int line, int first) const { return RowAt(static_cast<size_t>(kNumCenters + line * kLine + first)); }

 private:
  static constexpr int kLine = kSize + 1;
  static constexpr int kNumCenters = kSize * kSize;
  static constexpr int kNumSamples = kNumCenters + kLine * kLine;
  static constexpr int kNumPadded = (kNumSamples + kSize - 1) / kSize * kSize;

  Row RowAt(size_t first) const;
  Eigen::Vector2f RayAt(size_t sample) const { return {x_[sample], y_[sample]}; }
  void Place(int x, int y);
  void CastUnresolvedCorners(CellSurfaces& surfaces);

  const RayTable& table_;
  const RayCaster& caster_;
  alignas(16) std::array<float, kNumPadded> x_{};  ///< centres row by row, then corners
  alignas(16) std::array<float, kNumPadded> y_{};
  alignas(16) std::array<float, kNumPadded> slots_{};
  std::array<int32_t, kNumCenters> center_views_{};
};

}  // namespace mapp::sim
