#include "vision/orb_extractor.h"

#include "vision/corner_spreading.h"
#include "vision/opencv_util.h"

#include <fmt/format.h>
#include <opencv2/features2d.hpp>
#include <opencv2/imgproc.hpp>

#include <algorithm>
#include <array>
#include <cmath>
#include <cstring>
#include <numbers>
#include <string>
#include <utility>

namespace mapp {
namespace {

constexpr int kMinImageEdge = 64;
constexpr int kPatchRadius = 15;
constexpr int kPatchSize = 2 * kPatchRadius + 1;
/// Corners keep this distance from the level's border: the rotated pattern reaches 13 * sqrt(2) pixels.
constexpr int kBorder = 19;
/// A level narrower than this beyond its borders holds nothing worth detecting.
constexpr int kMinDetectionEdge = 8;

/// Half-width of each row of the disc in which the intensity centroid is taken (Rublee et al. 2011, section 3.2). The
/// disc u^2 + v^2 < (radius + 1/2)^2 looks the same along rows and columns, so quarter turns keep the angle exactly.
std::array<int, kPatchRadius + 1> DiscHalfWidths() {
  constexpr int kSquaredRadius = kPatchRadius * (kPatchRadius + 1);
  std::array<int, kPatchRadius + 1> widths{};
  for (int v = 0; v <= kPatchRadius; ++v) {
    widths[static_cast<size_t>(v)] = static_cast<int>(std::sqrt(static_cast<double>(kSquaredRadius - v * v)));
  }
  return widths;
}

/// Direction from the corner to the intensity centroid of its disc, radians in [0, 2 pi).
float CentroidAngle(const cv::Mat& level, int x, int y, const std::array<int, kPatchRadius + 1>& half_widths) {
  const auto step = static_cast<ptrdiff_t>(level.step1());
  const uint8_t* center = level.ptr<uint8_t>(y) + x;
  int moment_x = 0;
  int moment_y = 0;
  for (int u = -kPatchRadius; u <= kPatchRadius; ++u) moment_x += u * center[u];
  for (int v = 1; v <= kPatchRadius; ++v) {
    const uint8_t* below = center + v * step;
    const uint8_t* above = center - v * step;
    const int half_width = half_widths[static_cast<size_t>(v)];
    int row_difference = 0;
    for (int u = -half_width; u <= half_width; ++u) {
      row_difference += below[u] - above[u];
      moment_x += u * (below[u] + above[u]);
    }
    moment_y += v * row_difference;
  }
  constexpr float kTurn = 2.0F * std::numbers::pi_v<float>;
  const float angle = std::atan2(static_cast<float>(moment_y), static_cast<float>(moment_x));
  const float positive = angle < 0 ? angle + kTurn : angle;
  return positive < kTurn ? positive : 0.0F;
}

Status Validate(const OrbExtractorOptions& options) {
  if (options.num_features < 50 || options.num_features > kMaxFeatures) {
    return absl::InvalidArgumentError(
        fmt::format("num_features: must be in [50, {}], got {}", kMaxFeatures, options.num_features));
  }
  if (options.min_fast_threshold < 1 || options.min_fast_threshold > options.fast_threshold) {
    return absl::InvalidArgumentError(fmt::format("min_fast_threshold: must be in [1, fast_threshold = {}], got {}",
                                                  options.fast_threshold, options.min_fast_threshold));
  }
  if (options.fast_threshold > 254) {
    return absl::InvalidArgumentError(
        fmt::format("fast_threshold: must be at most 254, got {}", options.fast_threshold));
  }
  if (options.cell_px < 16 || options.cell_px > 512) {
    return absl::InvalidArgumentError(fmt::format("cell_px: must be in [16, 512], got {}", options.cell_px));
  }
  return absl::OkStatus();
}

}  // namespace

struct OrbExtractor::Impl {
  OrbExtractorOptions options;
  std::array<int, kPatchRadius + 1> half_widths = DiscHalfWidths();
  /// Describes corners of one level at a time, with OpenCV's learned (decorrelated) test pattern.
  cv::Ptr<cv::ORB> describer;
  std::array<cv::Mat, kPyramidLevels> pyramid;
  std::vector<cv::KeyPoint> corners;
  std::vector<cv::KeyPoint> cell_corners;
  cv::Mat descriptors;

  void BuildPyramid(const cv::Mat& image);
  void DetectCorners(const cv::Mat& level);
  void DescribeLevel(int octave, std::vector<Feature>& features);
  std::vector<Feature> Extract(const cv::Mat& image);
};

void OrbExtractor::Impl::BuildPyramid(const cv::Mat& image) {
  pyramid[0] = image;
  for (int octave = 1; octave < kPyramidLevels; ++octave) {
    const float scale = OctaveScale(octave);
    const cv::Size size(cvRound(static_cast<float>(image.cols) / scale),
                        cvRound(static_cast<float>(image.rows) / scale));
    const auto idx = static_cast<size_t>(octave);
    cv::resize(pyramid[idx - 1], pyramid[idx], size, 0, 0, cv::INTER_LINEAR);
  }
}

/// Fills `corners` with FAST corners of the level: by the high threshold where it finds any, else by the low one.
void OrbExtractor::Impl::DetectCorners(const cv::Mat& level) {
  corners.clear();
  const cv::Rect inner(kBorder, kBorder, level.cols - 2 * kBorder, level.rows - 2 * kBorder);
  if (inner.width < kMinDetectionEdge || inner.height < kMinDetectionEdge) return;
  // FAST looks 3 pixels around a corner and skips as many at the border of what it is given.
  constexpr int kFastReach = 3;
  const auto detect = [&](const cv::Rect& area, int threshold, std::vector<cv::KeyPoint>& found) {
    const cv::Rect padded(area.x - kFastReach, area.y - kFastReach, area.width + 2 * kFastReach,
                          area.height + 2 * kFastReach);
    cv::FAST(level(padded), found, threshold, /*nonmaxSuppression=*/true);
    for (cv::KeyPoint& corner : found)
      corner.pt += cv::Point2f(static_cast<float>(padded.x), static_cast<float>(padded.y));
  };
  detect(inner, options.fast_threshold, corners);

  const int columns = std::max(1, inner.width / options.cell_px);
  const int rows = std::max(1, inner.height / options.cell_px);
  std::vector<bool> occupied(static_cast<size_t>(columns) * static_cast<size_t>(rows), false);
  for (const cv::KeyPoint& corner : corners) {
    const int column = (static_cast<int>(corner.pt.x) - inner.x) * columns / inner.width;
    const int row = (static_cast<int>(corner.pt.y) - inner.y) * rows / inner.height;
    occupied[static_cast<size_t>(row * columns + column)] = true;
  }
  for (int row = 0; row < rows; ++row) {
    for (int column = 0; column < columns; ++column) {
      if (occupied[static_cast<size_t>(row * columns + column)]) continue;
      const int left = inner.x + column * inner.width / columns;
      const int right = inner.x + (column + 1) * inner.width / columns;
      const int top = inner.y + row * inner.height / rows;
      const int bottom = inner.y + (row + 1) * inner.height / rows;
      detect({left, top, right - left, bottom - top}, options.min_fast_threshold, cell_corners);
      corners.insert(corners.end(), cell_corners.begin(), cell_corners.end());
    }
  }
}

/// Orients and describes `corners` of one level and appends them in pixels of the full-size image.
void OrbExtractor::Impl::DescribeLevel(int octave, std::vector<Feature>& features) {
  const cv::Mat& level = pyramid[static_cast<size_t>(octave)];
  constexpr float kDegrees = 180.0F / std::numbers::pi_v<float>;
  for (size_t i = 0; i < corners.size(); ++i) {
    cv::KeyPoint& corner = corners[i];
    corner.angle =
        kDegrees * CentroidAngle(level, static_cast<int>(corner.pt.x), static_cast<int>(corner.pt.y), half_widths);
    corner.octave = 0;  // The describer sees this level alone.
    corner.class_id = static_cast<int>(i);
  }
  if (corners.empty()) return;
  describer->compute(level, corners, descriptors);

  // Levels are resized by their rounded sizes, and cv::resize aligns the outer edges of the pixels, not their centers.
  const float scale_x = static_cast<float>(pyramid[0].cols) / static_cast<float>(level.cols);
  const float scale_y = static_cast<float>(pyramid[0].rows) / static_cast<float>(level.rows);
  for (size_t i = 0; i < corners.size(); ++i) {
    const cv::KeyPoint& corner = corners[i];
    Feature& feature = features.emplace_back();
    feature.keypoint.u_px = (corner.pt.x + 0.5F) * scale_x - 0.5F;
    feature.keypoint.v_px = (corner.pt.y + 0.5F) * scale_y - 0.5F;
    feature.keypoint.angle = corner.angle / kDegrees;
    feature.keypoint.octave = static_cast<uint8_t>(octave);
    feature.descriptor = OrbDescriptor::FromBytes(descriptors.ptr<uint8_t>(static_cast<int>(i)));
  }
}

std::vector<Feature> OrbExtractor::Impl::Extract(const cv::Mat& image) {
  BuildPyramid(image);
  std::vector<Feature> features;
  features.reserve(static_cast<size_t>(options.num_features));
  double remaining_weight = 0;
  for (int octave = 0; octave < kPyramidLevels; ++octave) remaining_weight += 1.0 / OctaveScale(octave);
  // Finest level first; what a level could not fill, the coarser ones share.
  for (int octave = 0; octave < kPyramidLevels; ++octave) {
    const double weight = 1.0 / OctaveScale(octave);
    const int remaining = options.num_features - static_cast<int>(features.size());
    const int quota = static_cast<int>(std::lround(remaining * weight / remaining_weight));
    remaining_weight -= weight;
    const cv::Mat& level = pyramid[static_cast<size_t>(octave)];
    DetectCorners(level);
    internal::SpreadCorners(corners, level.cols, level.rows, quota);
    DescribeLevel(octave, features);
  }
  pyramid[0] = cv::Mat();  // The caller's pixels.
  return features;
}

OrbExtractor::OrbExtractor(std::unique_ptr<Impl> impl) : impl_(std::move(impl)) {}
OrbExtractor::~OrbExtractor() = default;

StatusOr<std::unique_ptr<OrbExtractor>> OrbExtractor::Create(const OrbExtractorOptions& options) {
  MAPP_RETURN_IF_ERROR(Validate(options));
  auto impl = std::make_unique<Impl>();
  impl->options = options;
  try {
    impl->describer = cv::ORB::create(kMaxFeatures, kPyramidScale, /*nlevels=*/1, /*edgeThreshold=*/kBorder,
                                      /*firstLevel=*/0, /*WTA_K=*/2, cv::ORB::HARRIS_SCORE, kPatchSize);
  } catch (const cv::Exception& error) {
    return absl::InternalError(fmt::format("create ORB describer: {}", error.what()));
  }
  return std::unique_ptr<OrbExtractor>(new OrbExtractor(std::move(impl)));
}

FeatureSettings OrbExtractor::feature_settings() const {
  return {.descriptor_kind = "ORB-256",
          .scale_factor = kPyramidScale,
          .num_levels = kPyramidLevels,
          .patch_size_px = kPatchSize};
}

StatusOr<std::vector<Feature>> OrbExtractor::Extract(ImageView<uint8_t> image) {
  if (image.empty() || image.width < kMinImageEdge || image.height < kMinImageEdge) {
    return absl::InvalidArgumentError(fmt::format("image: must be at least {0} x {0} pixels, got {1} x {2}",
                                                  kMinImageEdge, image.width, image.height));
  }
  try {
    return impl_->Extract(internal::WrapGray(image));
  } catch (const cv::Exception& error) {
    return absl::InternalError(fmt::format("extract ORB features: {}", error.what()));
  }
}

}  // namespace mapp
