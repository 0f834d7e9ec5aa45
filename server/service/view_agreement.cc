#include "server/service/view_agreement.h"

#include "server/service/alignment_projection.h"

#include <algorithm>
#include <array>
#include <vector>

namespace mapp {
namespace {

constexpr int kGridCells = 4;
static_assert(kGridCells * kGridCells == kNumAgreementCells);

/// A cell has something to say with this many points to be seen, and as many features to see them with.
constexpr int kMinPoints = 8;
// Of the lesser of the two, the share of inliers from which a cell agrees, and below which it contradicts
// (docs/decisions/0007).
constexpr double kAgreeing = 0.15;
constexpr double kContradicting = 0.08;
/// Features this near tell whether something stands before an expected point.
constexpr float kNear_px = 24;

int CellOf(const QueryKeyframe& query, double u_px, double v_px) {
  const Camera& camera = query.view().camera;
  const int column = std::clamp(static_cast<int>(u_px * kGridCells / camera.width_px), 0, kGridCells - 1);
  const int row = std::clamp(static_cast<int>(v_px * kGridCells / camera.height_px), 0, kGridCells - 1);
  return row * kGridCells + column;
}

/// Whether the keyframe looks as far as the point: unknown, and so false, without a feature of known depth around it.
bool LooksThatFar(const QueryKeyframe& query, const ExpectedPoint& point, std::vector<int>& around) {
  around.clear();
  query.grid().Find(point.pixel.x(), point.pixel.y(), kNear_px, around);
  return std::ranges::any_of(around, [&](int feature_idx) {
    return query.depth_m(feature_idx) > point.depth_m - query.tolerance_m(point.depth_m);
  });
}

}  // namespace

int AgreementCell(const QueryKeyframe& query, int feature_idx) {
  const Eigen::Vector2d& pixel = query.view().undistorted_px[static_cast<size_t>(feature_idx)];
  return CellOf(query, pixel.x(), pixel.y());
}

ViewAgreement CompareWithView(const QueryKeyframe& query, std::span<const ExpectedPoint> expected,
                              std::span<const AlignmentMatch> inliers) {
  struct Cell {
    int num_expected = 0;
    int num_features = 0;
    int num_inliers = 0;
  };
  std::array<Cell, kNumAgreementCells> cells;
  const auto cell_of_feature = [&](int feature_idx) -> Cell& {
    return cells[static_cast<size_t>(AgreementCell(query, feature_idx))];
  };
  for (int i = 0; i < static_cast<int>(query.features().size()); ++i) {
    if (query.depth_m(i) > 0) ++cell_of_feature(i).num_features;
  }
  for (const AlignmentMatch& inlier : inliers) ++cell_of_feature(inlier.feature_idx).num_inliers;
  std::vector<int> around;
  for (const ExpectedPoint& point : expected) {
    if (!LooksThatFar(query, point, around)) continue;
    ++cells[static_cast<size_t>(CellOf(query, point.pixel.x(), point.pixel.y()))].num_expected;
  }
  ViewAgreement agreement;
  for (const Cell& cell : cells) {
    const int to_match = std::min(cell.num_expected, cell.num_features);
    if (to_match < kMinPoints) continue;
    if (cell.num_inliers >= kAgreeing * to_match) ++agreement.num_agreeing;
    if (cell.num_inliers < kContradicting * to_match) ++agreement.num_contradicting;
  }
  return agreement;
}

}  // namespace mapp
