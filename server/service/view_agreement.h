#pragma once

#include "mapp/base/id.h"

#include <Eigen/Core>

#include <span>

namespace mapp {

class QueryKeyframe;
struct AlignmentMatch;

/// A map point as a camera should see it.
struct ExpectedPoint {
  Eigen::Vector2f pixel;  ///< undistorted
  float depth_m = 0;
};

/// In how many cells of a 4x4 grid over the image a keyframe shows what the map holds there, and in how many it shows
/// something else. Cells where either has little to say count as neither.
struct ViewAgreement {
  int num_agreeing = 0;
  int num_contradicting = 0;
};

/// Number of a feature's cell in that grid, row by row.
int AgreementCell(const QueryKeyframe& query, int feature_idx);
inline constexpr int kNumAgreementCells = 16;

/// `expected`: the map's points in the keyframe's view, those behind something nearer included; `inliers`: the matches
/// among them that agree with the pose. Equal cars and equal panels give many inliers in the wrong place, where all
/// around them contradicts; points that match do not tell the two apart, points that should and do not match do.
ViewAgreement CompareWithView(const QueryKeyframe& query, std::span<const ExpectedPoint> expected,
                              std::span<const AlignmentMatch> inliers);

}  // namespace mapp
