#pragma once

#include "sim/cell_grid.h"
#include "sim/quad_view.h"
#include "sim/ray_caster.h"
#include "sim/ray_table.h"

#include <array>
#include <cstdint>
#include <optional>
#include <vector>

namespace mapp::sim {

/// What the samples of one cell see: the centres of its pixels, and the corners that these share.
class CellSamples {
 public:
  static constexpr int kSize = CellGrid::kCell_px;
  static_assert(kSize == RayRow::kSize);
  /// The slot of what is not a surface.
  static constexpr int kSky = -1;

  CellSamples(const RayTable& rays, const RayCaster& caster) : table_(rays), caster_(caster) {}

  /// Starts with the cell whose top left pixel is (x, y).
  void Begin(int x, int y);
  /// Finds what every sample sees: the nearest candidate that it meets, and where it meets none, what a ray does.
  void Resolve(const CellGrid::Candidates& candidates);
  /// Finds the same by rays through the centres; corners see the surfaces that these meet.
  void Cast();

  /// The view that all samples see, kNoView for the sky; nullopt if they see several.
  std::optional<int32_t> OnlyView() const;
  /// A view that some sample may see, by slot, and the ray of one that does.
  struct Seen {
    int32_t view = kNoView;
    std::optional<Eigen::Vector2f> ray;
  };
  int num_slots() const { return static_cast<int>(views_.size()); }
  Seen At(int slot) const;

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

  Row RowAt(size_t first) const {
    using Values = Eigen::Map<const Eigen::Array4f>;
    return {{Values(&x_[first]), Values(&y_[first])}, Values(&slots_[first])};
  }
  /// Gives the samples from `begin` on the nearest of the views that they meet, or kSky.
  void ChooseNearest(size_t begin);
  /// Asks a ray where samples of [begin, end) see no surface yet.
  void CastWhereSky(size_t begin, size_t end);
  int SlotOf(int32_t view);

  const RayTable& table_;
  const RayCaster& caster_;
  alignas(16) std::array<float, kNumPadded> x_{};  ///< centres row by row, then corners
  alignas(16) std::array<float, kNumPadded> y_{};
  alignas(16) std::array<float, kNumPadded> slots_{};
  std::vector<int32_t> views_;  ///< by slot
};

}  // namespace mapp::sim
