#include "vision/stereo_matcher.h"

#include "vision/opencv_util.h"

#include <fmt/format.h>
#include <opencv2/calib3d.hpp>
#include <opencv2/imgproc.hpp>

#include <algorithm>
#include <cmath>
#include <limits>
#include <string>
#include <utility>

namespace mapp {
namespace {

constexpr double kMinBaseline_m = 0.001;

cv::Mat CameraMatrix(const Camera& camera) {
  const Eigen::Vector2d focal = camera.FocalLengths();
  const Eigen::Vector2d center = camera.PrincipalPoint();
  return (cv::Mat_<double>(3, 3) << focal.x(), 0, center.x(), 0, focal.y(), center.y(), 0, 0, 1);
}

/// k1, k2, p1, p2: what follows the four intrinsics; none for a pinhole.
cv::Mat Distortion(const Camera& camera) {
  const std::vector<double> coefficients = Coefficients(camera.projection);
  return cv::Mat(std::vector<double>(coefficients.begin() + 4, coefficients.end()), /*copyData=*/true);
}

cv::Mat ToMat(const Eigen::Matrix3d& matrix) {
  cv::Mat result(3, 3, CV_64F);
  for (int row = 0; row < 3; ++row) {
    for (int column = 0; column < 3; ++column) result.at<double>(row, column) = matrix(row, column);
  }
  return result;
}

Eigen::Matrix3d FromMat(const cv::Mat& matrix) {
  Eigen::Matrix3d result;
  for (int row = 0; row < 3; ++row) {
    for (int column = 0; column < 3; ++column) result(row, column) = matrix.at<double>(row, column);
  }
  return result;
}

Status Validate(const Camera& left, const Camera& right, const Pose3& T_left_right) {
  if (left.width_px != right.width_px || left.height_px != right.height_px) {
    return absl::InvalidArgumentError(
        fmt::format("right.width_px, height_px: must be those of the left camera, {} x {}"
                    ", got {} x {}",
                    left.width_px, left.height_px, right.width_px, right.height_px));
  }
  MAPP_RETURN_IF_ERROR(Annotate(left.Validate(), "left"));
  MAPP_RETURN_IF_ERROR(Annotate(right.Validate(), "right"));
  const Eigen::Vector3d& baseline = T_left_right.translation();
  if (!T_left_right.IsFinite() || baseline.norm() < kMinBaseline_m) {
    return absl::InvalidArgumentError(
        fmt::format("T_left_right: baseline must be at least {} m, got {} m", kMinBaseline_m, baseline.norm()));
  }
  if (baseline.x() < std::max(std::abs(baseline.y()), std::abs(baseline.z()))) {
    return absl::InvalidArgumentError(
        fmt::format("T_left_right: the right camera must lie to the right of the left one, got ({}, {}, {}) m",
                    baseline.x(), baseline.y(), baseline.z()));
  }
  return absl::OkStatus();
}

/// Fixed-point look-up maps of one camera, as cv::remap reads them fastest.
struct RemapTable {
  cv::Mat positions, fractions;

  /// Empty when the image is not of the calibrated size.
  GrayImage Apply(ImageView<uint8_t> image) const {
    if (image.empty() || image.width != positions.cols || image.height != positions.rows) return {};
    GrayImage rectified(image.width, image.height);
    cv::Mat target(image.height, image.width, CV_8UC1, rectified.pixels.data());
    cv::remap(internal::WrapGray(image), target, positions, fractions, cv::INTER_LINEAR, cv::BORDER_CONSTANT);
    return rectified;
  }
};

}  // namespace

struct StereoRectifier::Impl {
  Camera rectified;
  Pose3 T_left_rectified;
  RemapTable left_table, right_table;

  /// cv::stereoRectify (after Bouguet): both cameras turn by half the rotation between them, rows get aligned.
  void Compute(const Camera& left, const Camera& right, const Pose3& T_left_right);
};

void StereoRectifier::Impl::Compute(const Camera& left, const Camera& right, const Pose3& T_left_right) {
  const cv::Size size(left.width_px, left.height_px);
  const Pose3 T_right_left = T_left_right.Inverse();
  const Eigen::Vector3d& p_right_left = T_right_left.translation();
  const cv::Vec3d translation(p_right_left.x(), p_right_left.y(), p_right_left.z());
  cv::Mat left_rotation, right_rotation, left_projection, right_projection, disparity_to_depth;
  // alpha = 0: zoomed until every rectified pixel has been recorded.
  cv::stereoRectify(CameraMatrix(left), Distortion(left), CameraMatrix(right), Distortion(right), size,
                    ToMat(T_right_left.RotationMatrix()), translation, left_rotation, right_rotation, left_projection,
                    right_projection, disparity_to_depth, cv::CALIB_ZERO_DISPARITY, /*alpha=*/0, size);
  cv::initUndistortRectifyMap(CameraMatrix(left), Distortion(left), left_rotation, left_projection, size, CV_16SC2,
                              left_table.positions, left_table.fractions);
  cv::initUndistortRectifyMap(CameraMatrix(right), Distortion(right), right_rotation, right_projection, size, CV_16SC2,
                              right_table.positions, right_table.fractions);
  rectified.projection = PinholeCamera{left_projection.at<double>(0, 0), left_projection.at<double>(1, 1),
                                       left_projection.at<double>(0, 2), left_projection.at<double>(1, 2)};
  rectified.width_px = left.width_px;
  rectified.height_px = left.height_px;
  rectified.stereo_baseline_m = T_left_right.translation().norm();
  // OpenCV's rotation takes points of the left camera to the rectified one.
  T_left_rectified =
      Pose3(Eigen::Quaterniond(Eigen::Matrix3d(FromMat(left_rotation).transpose())), Eigen::Vector3d::Zero());
}

StereoRectifier::StereoRectifier(std::unique_ptr<Impl> impl) : impl_(std::move(impl)) {}
StereoRectifier::~StereoRectifier() = default;

StatusOr<std::unique_ptr<StereoRectifier>> StereoRectifier::Create(const Camera& left, const Camera& right,
                                                                   const Pose3& T_left_right) {
  MAPP_RETURN_IF_ERROR(Validate(left, right, T_left_right));
  auto impl = std::make_unique<Impl>();
  try {
    impl->Compute(left, right, T_left_right);
  } catch (const cv::Exception& error) {
    return absl::InternalError(fmt::format("rectify stereo pair: {}", error.what()));
  }
  MAPP_RETURN_IF_ERROR(Annotate(impl->rectified.Validate(), "rectified"));
  return std::unique_ptr<StereoRectifier>(new StereoRectifier(std::move(impl)));
}

const Camera& StereoRectifier::rectified() const { return impl_->rectified; }
const Pose3& StereoRectifier::T_left_rectified() const { return impl_->T_left_rectified; }

void StereoRectifier::Rectify(ImageView<uint8_t> left, ImageView<uint8_t> right, GrayImage* rectified_left,
                              GrayImage* rectified_right) const {
  *rectified_left = impl_->left_table.Apply(left);
  *rectified_right = impl_->right_table.Apply(right);
}

namespace {

/// Between the strict (50) and the loose (100) bound of Mur-Artal et al. 2015.
constexpr int kMaxHamming = 75;
/// Smaller disparities are mostly noise.
constexpr float kMinDisparity_px = 0.5F;
/// Corner positions are this exact at their own level, so the true row is within it in the other image.
constexpr float kRowBand_px = 2.0F;
/// Patch radius and sliding range at level 0, scaled by the level (Mur-Artal and Tardos 2017 slide 5 pixels).
constexpr float kPatchRadius_px = 5.0F;
constexpr float kSlide_px = 3.0F;
/// Patches worse than this many times the median are false matches (1.5 * 1.4 as in ORB-SLAM2).
constexpr double kMaxCostOverMedian = 2.1;

/// Right features by the rows in which a left feature may find them.
std::vector<std::vector<int>> IndexByRow(std::span<const Feature> right, int height_px) {
  std::vector<std::vector<int>> rows(static_cast<size_t>(height_px));
  for (size_t i = 0; i < right.size(); ++i) {
    const Keypoint& keypoint = right[i].keypoint;
    const float band = kRowBand_px * OctaveScale(keypoint.octave);
    const int first = std::max(0, static_cast<int>(std::floor(keypoint.v_px - band)));
    const int last = std::min(height_px - 1, static_cast<int>(std::ceil(keypoint.v_px + band)));
    for (int row = first; row <= last; ++row) rows[static_cast<size_t>(row)].push_back(static_cast<int>(i));
  }
  return rows;
}

/// Index of the right feature that looks most like `left` among those at a possible disparity; -1 for none.
int FindCandidate(const Feature& left, const std::vector<int>& row, std::span<const Feature> right,
                  float max_disparity_px) {
  int best_idx = -1;
  int best_distance = kMaxHamming + 1;
  for (const int idx : row) {
    const Feature& candidate = right[static_cast<size_t>(idx)];
    if (std::abs(candidate.keypoint.octave - left.keypoint.octave) > 1) continue;
    const float disparity_px = left.keypoint.u_px - candidate.keypoint.u_px;
    // The corners themselves are a pixel or so off; the refined disparity is checked again.
    if (disparity_px < -kRowBand_px || disparity_px > max_disparity_px) continue;
    const int distance = HammingDistance(left.descriptor, candidate.descriptor);
    if (distance < best_distance) {
      best_distance = distance;
      best_idx = idx;
    }
  }
  return best_idx;
}

/// A square patch, known to lie in its image.
struct Patch {
  ImageView<uint8_t> image;
  int x, y, radius;

  bool IsInside() const { return x >= radius && y >= radius && x + radius < image.width && y + radius < image.height; }
  int Sum() const {
    int sum = 0;
    for (int dy = -radius; dy <= radius; ++dy) {
      const uint8_t* row = &image.at(x - radius, y + dy);
      for (int dx = 0; dx <= 2 * radius; ++dx) sum += row[dx];
    }
    return sum;
  }
};

/// Mean absolute difference of two patches of one size after removal of their mean gray levels.
double PatchDifference(const Patch& a, int sum_a, const Patch& b) {
  const int edge = 2 * a.radius + 1;
  const int offset = static_cast<int>(std::lround(static_cast<double>(sum_a - b.Sum()) / (edge * edge)));
  int sum = 0;
  for (int dy = -a.radius; dy <= a.radius; ++dy) {
    const uint8_t* row_a = &a.image.at(a.x - a.radius, a.y + dy);
    const uint8_t* row_b = &b.image.at(b.x - b.radius, b.y + dy);
    for (int dx = 0; dx < edge; ++dx) sum += std::abs(row_a[dx] - row_b[dx] - offset);
  }
  return static_cast<double>(sum) / (edge * edge);
}

struct Refined {
  float disparity_px = 0;  ///< 0: no clear minimum
  double cost = 0;         ///< mean absolute gray difference
};

/// Slides the patch around `left` along the row of the right image about `right_u_px`; parabola through the minimum.
Refined RefineDisparity(const Keypoint& left, float right_u_px, ImageView<uint8_t> left_image,
                        ImageView<uint8_t> right_image) {
  const float scale = OctaveScale(left.octave);
  const int radius = static_cast<int>(std::lround(kPatchRadius_px * scale));
  const int range = static_cast<int>(std::ceil(kSlide_px * scale));
  const Patch left_patch{left_image, static_cast<int>(std::lround(left.u_px)), static_cast<int>(std::lround(left.v_px)),
                         radius};
  const int center_u = static_cast<int>(std::lround(right_u_px));
  if (!left_patch.IsInside()) return {};
  if (!Patch{right_image, center_u - range, left_patch.y, radius}.IsInside()) return {};
  if (!Patch{right_image, center_u + range, left_patch.y, radius}.IsInside()) return {};

  const int left_sum = left_patch.Sum();
  std::vector<double> costs;
  for (int shift = -range; shift <= range; ++shift) {
    costs.push_back(PatchDifference(left_patch, left_sum, {right_image, center_u + shift, left_patch.y, radius}));
  }
  const auto best = std::min_element(costs.begin(), costs.end());
  if (best == costs.begin() || best + 1 == costs.end()) return {};
  const double before = *(best - 1);
  const double after = *(best + 1);
  const double curvature = before + after - 2.0 * *best;
  const double fraction = curvature > 0 ? 0.5 * (before - after) / curvature : 0.0;
  const double right_u = center_u - range + static_cast<double>(best - costs.begin()) + fraction;
  // Both patches stand on whole pixels, so the difference holds although the corner itself lies between them.
  return {static_cast<float>(left_patch.x - right_u), *best};
}

}  // namespace

std::vector<float> MatchStereo(const Camera& rectified, std::span<const Feature> left, std::span<const Feature> right,
                               ImageView<uint8_t> left_image, ImageView<uint8_t> right_image) {
  std::vector<float> depths_m(left.size(), 0.0F);
  if (left_image.empty() || right_image.empty()) return depths_m;
  const auto fx = static_cast<float>(rectified.FocalLengths().x());
  const auto baseline_m = static_cast<float>(rectified.stereo_baseline_m);
  // Nothing is nearer than one baseline: disparity is at most the focal length.
  const float max_disparity_px = fx;
  const std::vector<std::vector<int>> rows = IndexByRow(right, left_image.height);

  std::vector<Refined> refined(left.size());
  std::vector<double> costs;
  for (size_t i = 0; i < left.size(); ++i) {
    const auto row = static_cast<int>(std::lround(left[i].keypoint.v_px));
    if (row < 0 || row >= left_image.height) continue;
    const int candidate = FindCandidate(left[i], rows[static_cast<size_t>(row)], right, max_disparity_px);
    if (candidate < 0) continue;
    refined[i] =
        RefineDisparity(left[i].keypoint, right[static_cast<size_t>(candidate)].keypoint.u_px, left_image, right_image);
    if (refined[i].disparity_px >= kMinDisparity_px) costs.push_back(refined[i].cost);
  }
  if (costs.empty()) return depths_m;
  const auto median = costs.begin() + static_cast<ptrdiff_t>(costs.size() / 2);
  std::nth_element(costs.begin(), median, costs.end());
  const double max_cost = kMaxCostOverMedian * *median;
  for (size_t i = 0; i < left.size(); ++i) {
    if (refined[i].disparity_px < kMinDisparity_px || refined[i].cost > max_cost) continue;
    depths_m[i] = fx * baseline_m / refined[i].disparity_px;
  }
  return depths_m;
}

}  // namespace mapp
