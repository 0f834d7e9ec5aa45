#include "sim/cell_grid.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <limits>

namespace mapp::sim {
namespace {

/// Edges mark all cells within this distance.
constexpr double kReach_px = 1;
/// Between points this far apart a lens bends no edge by more than a fraction of a pixel.
constexpr double kStraight_px = 15;
/// Lenses may draw an edge longer than a pinhole would, by less than this.
constexpr double kMaxStretch = 1.4;
/// Surfaces that touch have equal depth up to rounding.
constexpr double kInFront = 1 + 1e-4;

/// The part of the segment a, b in the field of view; false if there is none.
bool Clip(const Eigen::AlignedBox2f& bounds, Eigen::Vector3d& a, Eigen::Vector3d& b) {
  const Eigen::Vector2d low = bounds.min().cast<double>();
  const Eigen::Vector2d high = bounds.max().cast<double>();
  const std::array<Eigen::Vector4d, 5> sides = {
      Eigen::Vector4d(0, 0, 1, -kNearest_m), Eigen::Vector4d(1, 0, -low.x(), 0), Eigen::Vector4d(-1, 0, high.x(), 0),
      Eigen::Vector4d(0, 1, -low.y(), 0), Eigen::Vector4d(0, -1, high.y(), 0)};
  for (const Eigen::Vector4d& side : sides) {
    const double inside_a = side.head<3>().dot(a) + side.w();
    const double inside_b = side.head<3>().dot(b) + side.w();
    if (inside_a < 0 && inside_b < 0) return false;
    if (inside_a < 0) a += (b - a) * (inside_a / (inside_a - inside_b));
    if (inside_b < 0) b += (a - b) * (inside_b / (inside_b - inside_a));
  }
  return true;
}

int DivideUp(int size, int by) { return (size + by - 1) / by; }

/// Which of `count` cells, of those along one side of the image, is nearest to a position.
int CellOf(double position_px, int count) {
  return static_cast<int>(std::clamp(position_px / CellGrid::kCell_px, 0.0, count - 1.0));
}

}  // namespace

CellGrid::CellGrid(const RayTable& rays)
    : rays_(rays),
      columns_(DivideUp(rays.width(), kCell_px)),
      rows_(DivideUp(rays.height(), kCell_px)),
      block_columns_(DivideUp(columns_, kBlock)),
      stride_(static_cast<size_t>(columns_) + 1),
      corner_views_(stride_ * (static_cast<size_t>(rows_) + 1), kNoView),
      corners_agree_(static_cast<size_t>(columns_) * static_cast<size_t>(rows_)),
      further_(corners_agree_.size() * kMaxFurther),
      farthest_(corners_agree_.size(), std::numeric_limits<double>::infinity()),
      block_farthest_(BlockIndex(0, num_bands()), std::numeric_limits<double>::infinity()) {}

void CellGrid::CompareCorners(const std::vector<QuadView>& views, int band) {
  for (int row = band * kBlock; row < std::min((band + 1) * kBlock, rows_); ++row) {
    for (int column = 0; column < columns_; ++column) {
      const size_t cell = CellIndex(column, row);
      for (size_t i = 0; i < kMaxFurther; ++i)
        further_[cell * kMaxFurther + i].store(kNoView, std::memory_order_relaxed);
      const std::array<int32_t, 4> corners = CornersOf(column, row);
      const bool agree = std::ranges::all_of(corners, [&](int32_t view) { return view == corners[0]; });
      corners_agree_[cell] = agree ? 1 : 0;
      double& farthest = farthest_[cell];
      for (size_t i = 0; i < (agree ? 1 : corners.size()); ++i) {
        const int32_t view = corners[i];
        if (i > 0 && view == corners[i - 1]) continue;
        farthest =
            std::min(farthest, view == kNoView ? 0 : FarthestAround(views[static_cast<size_t>(view)], column, row));
      }
      double& block_farthest = block_farthest_[BlockIndex(column / kBlock, band)];
      block_farthest = std::min(block_farthest, farthest);
    }
  }
}

/// The least inverse depth of a surface in a cell and kCell_px around it; edges mark cells from less far.
double CellGrid::FarthestAround(const QuadView& view, int column, int row) const {
  const auto at = [&](int x, int y) {
    const Eigen::Vector2f ray = rays_.Corner(x, y);
    return view.InverseDepth(ray.x(), ray.y());
  };
  const auto [low, high] = std::minmax({at(FirstX(column), FirstY(row)), at(FirstX(column + 1), FirstY(row)),
                                        at(FirstX(column), FirstY(row + 1)), at(FirstX(column + 1), FirstY(row + 1))});
  // Cells at the border may be too small to tell.
  const bool is_whole = FirstX(column + 1) - FirstX(column) == kCell_px && FirstY(row + 1) - FirstY(row) == kCell_px;
  static_assert(kReach_px < kCell_px);
  return is_whole ? low - (high - low) : 0;
}

/// Whether what is seen wherever an edge between two pixels marks cells lies nearer than `inverse_depth`.
bool CellGrid::IsHidden(const Eigen::Vector2d& from, const Eigen::Vector2d& to, double inverse_depth) const {
  const auto block_of = [](double position_px, int count) {
    return static_cast<int>(std::clamp(position_px / (kBlock * kCell_px), 0.0, count - 1.0));
  };
  const Eigen::Vector2d low = from.cwiseMin(to).array() - kReach_px;
  const Eigen::Vector2d high = from.cwiseMax(to).array() + kReach_px;
  const int last_column = block_of(high.x(), block_columns_);
  const int last_row = block_of(high.y(), num_bands());
  for (int row = block_of(low.y(), num_bands()); row <= last_row; ++row) {
    for (int column = block_of(low.x(), block_columns_); column <= last_column; ++column) {
      if (inverse_depth > kInFront * block_farthest_[BlockIndex(column, row)]) return false;
    }
  }
  return true;
}

void CellGrid::MarkEdges(const std::vector<QuadView>& views, int32_t view_idx) {
  const auto& outline = views[static_cast<size_t>(view_idx)].outline_camera;
  for (size_t i = 0; i < outline.size(); ++i) MarkEdge(views, view_idx, outline[i], outline[(i + 1) % outline.size()]);
}

void CellGrid::MarkEdge(const std::vector<QuadView>& views, int32_t view_idx, const Eigen::Vector3d& from_camera,
                        const Eigen::Vector3d& to_camera) {
  Eigen::Vector3d from = from_camera;
  Eigen::Vector3d to = to_camera;
  if (!Clip(rays_.bounds(), from, to)) return;
  // Along a straight line, the point on z = 1 and the inverse depth change evenly with each other.
  const Eigen::Vector3d begin(from.x() / from.z(), from.y() / from.z(), 1 / from.z());
  const Eigen::Vector3d end(to.x() / to.z(), to.y() / to.z(), 1 / to.z());
  const Eigen::Vector2d focal_px = rays_.camera().FocalLengths();
  const double length_px = kMaxStretch * (end - begin).head<2>().cwiseProduct(focal_px).norm();
  const int num_pieces = static_cast<int>(length_px / kStraight_px) + 1;
  const Eigen::Vector3d step = (end - begin) / num_pieces;
  Eigen::Vector2d pixel = rays_.ToImage(begin.head<2>());
  for (int i = 0; i < num_pieces; ++i) {
    const Eigen::Vector3d at = begin + i * step;
    const Eigen::Vector2d next_pixel = rays_.ToImage((at + step).head<2>());
    if (!IsHidden(pixel, next_pixel, std::max(at.z(), at.z() + step.z()))) {
      MarkPiece(views, view_idx, {{pixel, next_pixel}, {at, at + step}});
    }
    pixel = next_pixel;
  }
}

void CellGrid::MarkPiece(const std::vector<QuadView>& views, int32_t view_idx, const Piece& piece) {
  const auto& [from, to] = piece.pixels;
  const int last_row = CellOf(std::max(from.y(), to.y()) + kReach_px, rows_);
  for (int row = CellOf(std::min(from.y(), to.y()) - kReach_px, rows_); row <= last_row; ++row) {
    // The part of the piece that comes near the row.
    std::array<double, 2> share = {0, 1};
    if (const double rise = to.y() - from.y(); rise != 0) {
      const double at_top = (row * kCell_px - kReach_px - from.y()) / rise;
      const double at_bottom = ((row + 1) * kCell_px + kReach_px - from.y()) / rise;
      share = {std::clamp(std::min(at_top, at_bottom), 0.0, 1.0), std::clamp(std::max(at_top, at_bottom), 0.0, 1.0)};
    }
    Piece part;
    for (size_t i = 0; i < share.size(); ++i) {
      part.pixels[i] = from + share[i] * (to - from);
      part.points[i] = piece.points[0] + share[i] * (piece.points[1] - piece.points[0]);
    }
    MarkRow(views, view_idx, part, row);
  }
}

void CellGrid::MarkRow(const std::vector<QuadView>& views, int32_t view_idx, const Piece& part, int row) {
  const auto [low_x, high_x] = std::minmax(part.pixels[0].x(), part.pixels[1].x());
  const double nearest = std::max(part.points[0].z(), part.points[1].z());
  const int last_column = CellOf(high_x + kReach_px, columns_);
  for (int column = CellOf(low_x - kReach_px, columns_); column <= last_column; ++column) {
    const size_t cell = CellIndex(column, row);
    if (nearest <= kInFront * farthest_[cell]) continue;
    const std::array<int32_t, 4> corners = CornersOf(column, row);
    if (std::ranges::find(corners, view_idx) != corners.end()) continue;
    // Where all corners see one surface, the edge is compared with it where it is. Both inverse depths change evenly
    // along the edge: one of its ends is in front if any place is.
    const int32_t seen = corners_agree_[cell] != 0 ? corners[0] : kNoView;
    const bool in_front = seen == kNoView || std::ranges::any_of(part.points, [&](const Eigen::Vector3d& point) {
                            const QuadView& view = views[static_cast<size_t>(seen)];
                            return point.z() > kInFront * view.InverseDepth(point.x(), point.y());
                          });
    if (in_front) AddFurther(cell, view_idx);
  }
}

/// Several threads may add to one cell.
void CellGrid::AddFurther(size_t cell, int32_t view_idx) {
  for (size_t i = 0; i < kMaxFurther; ++i) {
    std::atomic<int32_t>& further = further_[cell * kMaxFurther + i];
    int32_t known = further.load(std::memory_order_relaxed);
    if (known == kNoView && further.compare_exchange_strong(known, view_idx, std::memory_order_relaxed)) return;
    if (known == view_idx) return;
  }
}

void CellGrid::Candidates::AddIfNew(int32_t view) {
  const auto end = views_.begin() + static_cast<std::ptrdiff_t>(size_);
  if (view != kNoView && std::find(views_.begin(), end, view) == end) views_[size_++] = view;
}

std::optional<CellGrid::Candidates> CellGrid::CandidatesOf(int column, int row) const {
  const size_t cell = CellIndex(column, row);
  // A cell that is full may have had more.
  if (FurtherOf(cell, kMaxFurther - 1).load(std::memory_order_relaxed) != kNoView) return std::nullopt;
  Candidates candidates;
  for (const int32_t view : CornersOf(column, row)) candidates.AddIfNew(view);
  for (size_t i = 0; i < kMaxFurther; ++i) {
    candidates.AddIfNew(FurtherOf(cell, i).load(std::memory_order_relaxed));
  }
  std::sort(candidates.views_.begin(), candidates.views_.begin() + static_cast<std::ptrdiff_t>(candidates.size_));
  return candidates;
}

}  // namespace mapp::sim
