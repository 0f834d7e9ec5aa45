#include "sim/cell_grid.h"

#include "sim/ray_caster.h"

#include <algorithm>
#include <array>
#include <cmath>

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

int NumCells(int size_px) { return (size_px + CellGrid::kCell_px - 1) / CellGrid::kCell_px; }

}  // namespace

CellGrid::CellGrid(const RayTable& rays)
    : rays_(rays),
      columns_(NumCells(rays.width())),
      rows_(NumCells(rays.height())),
      stride_(static_cast<size_t>(columns_) + 1),
      corner_views_(stride_ * (static_cast<size_t>(rows_) + 1), kNoView),
      states_(static_cast<size_t>(columns_) * static_cast<size_t>(rows_)) {}

void CellGrid::CompareCorners(int row) {
  const int32_t* top = CornerViews(row);
  const int32_t* bottom = CornerViews(row + 1);
  for (int column = 0; column < columns_; ++column) {
    const int32_t view = top[column];
    const bool agree = view == top[column + 1] && view == bottom[column] && view == bottom[column + 1];
    states_[CellIndex(column, row)].store(agree ? State::kPlain : State::kMixed, std::memory_order_relaxed);
  }
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
    for (int j = 0; j <= num_steps; ++j) {
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
