#pragma once

#include "sim/quad_view.h"
#include "sim/ray_table.h"

#include <array>
#include <atomic>
#include <cstdint>
#include <optional>
#include <span>
#include <vector>

namespace mapp::sim {

/// An image divided into cells of 4 x 4 pixels, and what is known of each: the views that its corners see, and those of
/// which an edge stands in front of what they see. A cell whose corners all see one view, with no edge in front, shows
/// nothing else: a surface that covers none of the corners would show an edge.
class CellGrid {
 public:
  static constexpr int kCell_px = 4;

  explicit CellGrid(const RayTable& rays);

  int columns() const { return columns_; }
  int rows() const { return rows_; }
  /// Pixel at which cell column or row `i` starts; also valid one past the last.
  int FirstX(int i) const { return std::min(i * kCell_px, rays_.width()); }
  int FirstY(int i) const { return std::min(i * kCell_px, rays_.height()); }

  /// The views that the cells' corners see on one line of corners, `line` in [0, rows()]: columns() + 1 of them.
  int32_t* CornerViews(int line) { return &corner_views_[static_cast<size_t>(line) * stride_]; }
  const int32_t* CornerViews(int line) const { return &corner_views_[static_cast<size_t>(line) * stride_]; }

  /// Marks the cells where an edge of `views[view_idx]` stands in front of a view that their corners see. May be called
  /// by several threads for different views once all corners have been compared.
  void MarkEdges(const std::vector<QuadView>& views, int32_t view_idx);

  /// Compares the corners of the cells of a band of rows; once all corners are filled, before edges are marked.
  void CompareCorners(const std::vector<QuadView>& views, int band);
  int num_bands() const { return (rows_ + kBlock - 1) / kBlock; }

  /// Whether the cell shows nothing but what its top left corner sees.
  bool IsPlain(int column, int row) const {
    const size_t cell = CellIndex(column, row);
    return corners_agree_[cell] != 0 && FurtherOf(cell, 0).load(std::memory_order_relaxed) == kNoView;
  }

  /// Views with an edge in a cell beyond those of its corners; a cell with as many is crowded.
  static constexpr size_t kMaxFurther = 8;

  /// Views of which some may be seen in a cell. In the same order whichever thread marked first.
  class Candidates {
   public:
    std::span<const int32_t> views() const { return {views_.data(), size_}; }

   private:
    friend class CellGrid;
    void AddIfNew(int32_t view);
    std::array<int32_t, 4 + kMaxFurther> views_;
    size_t size_ = 0;
  };
  /// Those that the cell's corners see and those that have an edge in front of them. What a place in the cell sees is
  /// the nearest of them that it meets; at a place that meets none there may be anything. Nullopt: the cell is crowded.
  std::optional<Candidates> CandidatesOf(int column, int row) const;

 private:
  /// Edges that are hidden by all that is seen around them are found by blocks of this many cells each way.
  static constexpr int kBlock = 4;

  size_t BlockIndex(int column, int band) const {
    return static_cast<size_t>(band) * static_cast<size_t>(block_columns_) + static_cast<size_t>(column);
  }
  size_t CellIndex(int column, int row) const {
    return static_cast<size_t>(row) * static_cast<size_t>(columns_) + static_cast<size_t>(column);
  }
  const std::atomic<int32_t>& FurtherOf(size_t cell, size_t i) const { return further_[cell * kMaxFurther + i]; }
  std::array<int32_t, 4> CornersOf(int column, int row) const {
    const int32_t* top = CornerViews(row) + column;
    const int32_t* bottom = CornerViews(row + 1) + column;
    return {top[0], top[1], bottom[0], bottom[1]};
  }
  void AddFurther(size_t cell, int32_t view_idx);
  void MarkEdge(const std::vector<QuadView>& views, int32_t view_idx, const Eigen::Vector3d& from_camera,
                const Eigen::Vector3d& to_camera);
  double FarthestAround(const QuadView& view, int column, int row) const;
  bool IsHidden(const Eigen::Vector2d& from, const Eigen::Vector2d& to, double inverse_depth) const;
  /// A straight part of an edge: its ends in the image, and each end's point on z = 1 with the inverse depth.
  struct Piece {
    std::array<Eigen::Vector2d, 2> pixels;
    std::array<Eigen::Vector3d, 2> points;
  };
  void MarkPiece(const std::vector<QuadView>& views, int32_t view_idx, const Piece& piece);
  void MarkRow(const std::vector<QuadView>& views, int32_t view_idx, const Piece& part, int row);

  const RayTable& rays_;
  const int columns_;
  const int rows_;
  const int block_columns_;
  const size_t stride_;
  std::vector<int32_t> corner_views_;
  std::vector<uint8_t> corners_agree_;         ///< by cell, row-major: whether its corners see one view, or all nothing
  std::vector<std::atomic<int32_t>> further_;  ///< kMaxFurther by cell: views with an edge in front, then kNoView
  std::vector<double> farthest_;               ///< by cell: the least inverse depth around it of what its corners see
  std::vector<double> block_farthest_;         ///< by block, row-major: the least of its cells
};

}  // namespace mapp::sim
