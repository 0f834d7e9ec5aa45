#pragma once

#include "sim/quad_view.h"
#include "sim/ray_table.h"

#include <atomic>
#include <cstdint>
#include <vector>

namespace mapp::sim {

/// An image divided into cells of 4 x 4 pixels, and what is known of each: the views that its corners see, and whether
/// an edge of another surface stands in front of what they see. A cell whose corners all see one view, with no edge in
/// front, shows nothing else: a surface that covers none of the corners would show an edge.
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

  /// Marks the cells where an edge of `views[view_idx]` stands in front of the one view that their corners see. May be
  /// called by several threads for different views once all corners are filled.
  void MarkEdges(const std::vector<QuadView>& views, int32_t view_idx);

  /// Compares the corners of the cells of a band of rows; once all corners are filled, before edges are marked.
  void CompareCorners(const std::vector<QuadView>& views, int band);
  int num_bands() const { return (rows_ + kBlock - 1) / kBlock; }

  /// Whether the four corners of the cell see one view, or all nothing.
  bool CornersAgree(int column, int row) const { return StateOf(column, row) != State::kMixed; }

  /// Whether the cell shows nothing but what its top left corner sees.
  bool IsPlain(int column, int row) const { return StateOf(column, row) == State::kPlain; }

 private:
  enum class State : uint8_t {
    kMixed,      ///< its corners see different views
    kPlain,      ///< they see the same
    kSuspected,  ///< they do, and an edge stands in front of it
  };

  /// Edges that are hidden by all that is seen around them are found by blocks of this many cells each way.
  static constexpr int kBlock = 4;

  size_t BlockIndex(int column, int band) const {
    return static_cast<size_t>(band) * static_cast<size_t>(block_columns_) + static_cast<size_t>(column);
  }
  size_t CellIndex(int column, int row) const {
    return static_cast<size_t>(row) * static_cast<size_t>(columns_) + static_cast<size_t>(column);
  }
  State StateOf(int column, int row) const { return states_[CellIndex(column, row)].load(std::memory_order_relaxed); }
  void MarkEdge(const std::vector<QuadView>& views, int32_t view_idx, const Eigen::Vector3d& from_camera,
                const Eigen::Vector3d& to_camera);
  double FarthestAround(const QuadView& view, int column, int row) const;
  bool IsHidden(const Eigen::Vector2d& from, const Eigen::Vector2d& to, double inverse_depth) const;
  void MarkAround(const std::vector<QuadView>& views, int32_t view_idx, const Eigen::Vector3d& at,
                  const Eigen::Vector2d& pixel);

  const RayTable& rays_;
  const int columns_;
  const int rows_;
  const int block_columns_;
  const size_t stride_;
  std::vector<int32_t> corner_views_;
  std::vector<std::atomic<State>> states_;  ///< by cell, row-major
  std::vector<double> farthest_;            ///< by block, row-major: the least inverse depth seen in its plain cells
};

}  // namespace mapp::sim
