#include "sim/cell_grid.h"

#include "sim/ray_caster.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <limits>

namespace mapp::sim {
namespace {

/// Edges are followed in steps of this many pixels; each step marks all cells within half a step and some slack.
constexpr double kStep_px = 3;
constexpr double kReach_px = 2;
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

}  // namespace

CellGrid::CellGrid(const RayTable& rays)
    : rays_(rays),
      columns_(DivideUp(rays.width(), kCell_px)),
      rows_(DivideUp(rays.height(), kCell_px)),
      block_columns_(DivideUp(columns_, kBlock)),
      stride_(static_cast<size_t>(columns_) + 1),
      corner_views_(stride_ * (static_cast<size_t>(rows_) + 1), kNoView),
      states_(static_cast<size_t>(columns_) * static_cast<size_t>(rows_)),
      farthest_(BlockIndex(0, num_bands()), std::numeric_limits<double>::infinity()) {}

void CellGrid::CompareCorners(const std::vector<QuadView>& views, int band) {
  for (int row = band * kBlock; row < std::min((band + 1) * kBlock, rows_); ++row) {
    const int32_t* top = CornerViews(row);
    const int32_t* bottom = CornerViews(row + 1);
    for (int column = 0; column < columns_; ++column) {
      const int32_t view = top[column];
      const bool agree = view == top[column + 1] && view == bottom[column] && view == bottom[column + 1];
      states_[CellIndex(column, row)].store(agree ? State::kPlain : State::kMixed, std::memory_order_relaxed);
      if (!agree) continue;
      double& farthest = farthest_[BlockIndex(column / kBlock, band)];
      farthest =
          std::min(farthest, view == kNoView ? 0 : FarthestAround(views[static_cast<size_t>(view)], column, row));
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
      if (inverse_depth > kInFront * farthest_[BlockIndex(column, row)]) return false;
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
  const int num_steps = static_cast<int>(length_px / num_pieces / kStep_px) + 1;
  const Eigen::Vector3d piece = (end - begin) / num_pieces;
  Eigen::Vector2d pixel = rays_.ToImage(begin.head<2>());
  for (int i = 0; i < num_pieces; ++i) {
    const Eigen::Vector3d at = begin + i * piece;
    const Eigen::Vector2d next_pixel = rays_.ToImage((at + piece).head<2>());
    const bool is_hidden = IsHidden(pixel, next_pixel, std::max(at.z(), at.z() + piece.z()));
    for (int j = 0; !is_hidden && j <= num_steps; ++j) {
      const double share = static_cast<double>(j) / num_steps;
      MarkAround(views, view_idx, at + share * piece, pixel + share * (next_pixel - pixel));
    }
    pixel = next_pixel;
  }
}

/// `at`: a point of the edge on z = 1, and its inverse depth.
void CellGrid::MarkAround(const std::vector<QuadView>& views, int32_t view_idx, const Eigen::Vector3d& at,
                          const Eigen::Vector2d& pixel) {
  const auto cell_of = [](double position_px, int count) {
    return static_cast<int>(std::clamp(position_px / kCell_px, 0.0, count - 1.0));
  };
  const int last_column = cell_of(pixel.x() + kReach_px, columns_);
  const int last_row = cell_of(pixel.y() + kReach_px, rows_);
  for (int row = cell_of(pixel.y() - kReach_px, rows_); row <= last_row; ++row) {
    for (int column = cell_of(pixel.x() - kReach_px, columns_); column <= last_column; ++column) {
      if (!IsPlain(column, row)) continue;
      const int32_t seen = CornerViews(row)[column];
      if (seen == view_idx) continue;
      const bool in_front =
          seen == kNoView || at.z() > kInFront * views[static_cast<size_t>(seen)].InverseDepth(at.x(), at.y());
      if (in_front) states_[CellIndex(column, row)].store(State::kSuspected, std::memory_order_relaxed);
    }
  }
}

}  // namespace mapp::sim
