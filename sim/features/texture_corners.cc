#include "sim/features/texture_corners.h"

#include <opencv2/features2d.hpp>
#include <opencv2/imgproc.hpp>

#include <algorithm>
#include <numbers>
#include <tuple>

namespace mapp::sim {
namespace {

constexpr int kCell_px = 64;
/// Levels smaller than this hold no whole patch.
constexpr int kMinLevelEdge_px = 24;
/// ORB wants 31 pixels around a corner, and FAST a few more.
constexpr int kPadding_px = 36;
/// The lowest threshold the extractor tries is 7, where a lamp may have brightened what is 6 in the texture.
constexpr int kFastThreshold = 6;
constexpr int kOrbEdge_px = 31;
constexpr int kAllCorners = 1'000'000;

cv::Ptr<cv::ORB> MakeDetector() {
  return cv::ORB::create(kAllCorners, kPyramidScale, /*nlevels=*/1, kOrbEdge_px, /*firstLevel=*/0, /*WTA_K=*/2,
                         cv::ORB::FAST_SCORE, kOrbEdge_px, kFastThreshold);
}

/// Keeps corners inside the picture proper, the strongest of each cell, sorted by cell and strength.
void Thin(std::vector<cv::KeyPoint>& corners, const cv::Size& size, int columns, int rows) {
  const auto cell_of = [&](const cv::KeyPoint& corner) {
    const int column = std::min(columns - 1, static_cast<int>(corner.pt.x - kPadding_px) / kCell_px);
    const int row = std::min(rows - 1, static_cast<int>(corner.pt.y - kPadding_px) / kCell_px);
    return row * columns + column;
  };
  std::erase_if(corners, [&](const cv::KeyPoint& corner) {
    const cv::Point2f at(corner.pt.x - kPadding_px, corner.pt.y - kPadding_px);
    return at.x < 0 || at.y < 0 || at.x >= static_cast<float>(size.width) || at.y >= static_cast<float>(size.height);
  });
  for (cv::KeyPoint& corner : corners) corner.class_id = cell_of(corner);
  std::sort(corners.begin(), corners.end(), [](const cv::KeyPoint& a, const cv::KeyPoint& b) {
    return std::tuple(a.class_id, -a.response, a.pt.y, a.pt.x) < std::tuple(b.class_id, -b.response, b.pt.y, b.pt.x);
  });
  std::vector<cv::KeyPoint> kept;
  int num_in_cell = 0;
  for (const cv::KeyPoint& corner : corners) {
    num_in_cell = !kept.empty() && kept.back().class_id == corner.class_id ? num_in_cell + 1 : 1;
    if (num_in_cell <= TextureCorners::kMaxPerCell) kept.push_back(corner);
  }
  corners = std::move(kept);
}

CornerLevel DescribeLevel(const cv::Mat& picture, double pitch_texels, cv::ORB& orb) {
  CornerLevel level;
  level.pitch_texels = pitch_texels;
  level.cell_texels = kCell_px * pitch_texels;
  level.columns = (picture.cols + kCell_px - 1) / kCell_px;
  level.rows = (picture.rows + kCell_px - 1) / kCell_px;
  cv::Mat padded;
  cv::copyMakeBorder(picture, padded, kPadding_px, kPadding_px, kPadding_px, kPadding_px, cv::BORDER_WRAP);
  std::vector<cv::KeyPoint> corners;
  orb.detect(padded, corners);
  Thin(corners, picture.size(), level.columns, level.rows);
  cv::Mat descriptors;
  if (!corners.empty()) orb.compute(padded, corners, descriptors);

  level.cell_start.assign(static_cast<size_t>(level.columns * level.rows) + 1, 0);
  constexpr float kRadians = std::numbers::pi_v<float> / 180.0F;
  for (size_t i = 0; i < corners.size(); ++i) {
    const cv::KeyPoint& corner = corners[i];
    TextureCorner& added = level.corners.emplace_back();
    added.x_texels = (corner.pt.x - kPadding_px + 0.5F) * static_cast<float>(pitch_texels);
    added.y_texels = (corner.pt.y - kPadding_px + 0.5F) * static_cast<float>(pitch_texels);
    added.angle = corner.angle * kRadians;
    added.response = corner.response;
    added.descriptor = OrbDescriptor::FromBytes(descriptors.ptr<uint8_t>(static_cast<int>(i)));
    ++level.cell_start[static_cast<size_t>(corner.class_id) + 1];
  }
  for (size_t cell = 1; cell < level.cell_start.size(); ++cell) level.cell_start[cell] += level.cell_start[cell - 1];
  return level;
}

}  // namespace

std::span<const TextureCorner> CornerLevel::Cell(int column, int row) const {
  const auto cell = static_cast<size_t>(row * columns + column);
  return {corners.data() + cell_start[cell], cell_start[cell + 1] - cell_start[cell]};
}

TextureCorners::TextureCorners(const GrayImage& picture)
    : width_texels_(picture.width), height_texels_(picture.height) {
  const cv::Ptr<cv::ORB> orb = MakeDetector();
  cv::Mat level(picture.height, picture.width, CV_8UC1, const_cast<uint8_t*>(picture.View().data),
                static_cast<size_t>(picture.View().stride));
  double pitch_texels = 1;
  while (std::min(level.cols, level.rows) >= kMinLevelEdge_px) {
    levels_.push_back(DescribeLevel(level, pitch_texels, *orb));
    pitch_texels *= static_cast<double>(kPyramidScale);
    const cv::Size size(cvRound(picture.width / pitch_texels), cvRound(picture.height / pitch_texels));
    if (size.width < 1 || size.height < 1) break;
    cv::Mat next;
    cv::resize(level, next, size, 0, 0, cv::INTER_LINEAR);
    level = next;
  }
}

}  // namespace mapp::sim
