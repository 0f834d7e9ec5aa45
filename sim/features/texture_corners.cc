#include "sim/features/texture_corners.h"

#include <opencv2/features2d.hpp>

#include <algorithm>
#include <cmath>
#include <numbers>
#include <tuple>
#include <utility>

namespace mapp::sim {
namespace {

constexpr int kCell_px = 64;
/// Levels smaller than this hold no whole patch.
constexpr int kMinLevelEdge_px = 24;
/// ORB wants 31 pixels around a corner, and FAST a few more: what a block holds does not depend on where it ends.
constexpr int kPadding_px = 36;
/// The lowest threshold the extractor tries is 7, where a lamp may have brightened what is 6 in the texture.
constexpr int kFastThreshold = 6;
constexpr int kOrbEdge_px = 31;
/// Of a block. Weaker ones would have to stand alone in a corner of it to be among an image's.
constexpr int kMaxPerBlock = 400;
/// A pixel blurs over this much of its width, as in rendered images.
constexpr double kSharpness = 0.7;

/// Gray levels of the pixels [left, left + size) x [top, top + size) of the picture at one size.
cv::Mat Draw(const TexturePicture& picture, double pitch_texels, const cv::Size& level_px, const cv::Rect& part) {
  const double footprint = kSharpness * pitch_texels * std::exp(std::abs(picture.log_aspect) / 2);
  const auto mip_level = static_cast<float>(std::log2(std::max(footprint, 1.0)));
  const auto along = [](int pixel, int size_px, bool flip) {
    const float share = (static_cast<float>(pixel) + 0.5F) / static_cast<float>(size_px);
    return flip ? 1 - share : share;
  };
  cv::Mat drawn(part.height, part.width, CV_8UC1);
  for (int y = 0; y < part.height; ++y) {
    uint8_t* const row = drawn.ptr<uint8_t>(y);
    const auto v = Eigen::Array4f::Constant(along(part.y + y, level_px.height, false));
    for (int x = 0; x < part.width; x += 4) {
      Eigen::Array4f u;
      for (int i = 0; i < 4; ++i) u[i] = along(part.x + x + i, level_px.width, picture.flip_u);
      const Eigen::Array4f gray = picture.texture->SampleLevel(u, v, mip_level, Texture::Beyond::kRepeat);
      for (int i = 0; i < std::min(4, part.width - x); ++i) row[x + i] = static_cast<uint8_t>(gray[i] + 0.5F);
    }
  }
  return drawn;
}

cv::Ptr<cv::ORB> MakeDetector() {
  return cv::ORB::create(kMaxPerBlock, kPyramidScale, /*nlevels=*/1, kOrbEdge_px, /*firstLevel=*/0, /*WTA_K=*/2,
                         cv::ORB::FAST_SCORE, kOrbEdge_px, kFastThreshold);
}

/// Keeps corners inside `inner`, the strongest of each of its cells, sorted by cell and strength. Leaves the cell's
/// number as the corner's class.
void Thin(std::vector<cv::KeyPoint>& corners, const cv::Rect& inner, int columns) {
  std::erase_if(corners, [&](const cv::KeyPoint& corner) {
    return !inner.contains(cv::Point(static_cast<int>(corner.pt.x), static_cast<int>(corner.pt.y)));
  });
  for (cv::KeyPoint& corner : corners) {
    const int column = (static_cast<int>(corner.pt.x) - inner.x) / kCell_px;
    const int row = (static_cast<int>(corner.pt.y) - inner.y) / kCell_px;
    corner.class_id = row * columns + column;
  }
  std::sort(corners.begin(), corners.end(), [](const cv::KeyPoint& a, const cv::KeyPoint& b) {
    return std::tuple(a.class_id, -a.response, a.pt.y, a.pt.x) < std::tuple(b.class_id, -b.response, b.pt.y, b.pt.x);
  });
  std::vector<cv::KeyPoint> kept;
  int num_in_cell = 0;
  for (const cv::KeyPoint& corner : corners) {
    num_in_cell = !kept.empty() && kept.back().class_id == corner.class_id ? num_in_cell + 1 : 1;
    if (num_in_cell <= CornerLevel::kMaxPerCell) kept.push_back(corner);
  }
  corners = std::move(kept);
}

}  // namespace

CornerLevel::CornerLevel(const TexturePicture& picture, double pitch_texels, int width_px, int height_px)
    : picture_(picture),
      pitch_texels_(pitch_texels),
      width_px_(width_px),
      height_px_(height_px),
      columns_((width_px + kCell_px - 1) / kCell_px),
      rows_((height_px + kCell_px - 1) / kCell_px),
      block_columns_((columns_ + kBlockCells - 1) / kBlockCells) {
  const int block_rows = (rows_ + kBlockCells - 1) / kBlockCells;
  blocks_ = std::make_unique<Block[]>(static_cast<size_t>(block_columns_ * block_rows));
}

double CornerLevel::cell_texels() const { return kCell_px * pitch_texels_; }

std::span<const TextureCorner> CornerLevel::Cell(int column, int row) const {
  const int block_column = column / kBlockCells;
  const int block_row = row / kBlockCells;
  Block& block = blocks_[static_cast<size_t>(block_row * block_columns_ + block_column)];
  std::call_once(block.once, [&] { Fill(block_column, block_row, block); });
  const auto cell = static_cast<size_t>(row % kBlockCells * kBlockCells + column % kBlockCells);
  return {block.corners.data() + block.cell_start[cell], block.cell_start[cell + 1] - block.cell_start[cell]};
}

void CornerLevel::Fill(int block_column, int block_row, Block& block) const {
  constexpr int kBlock_px = kBlockCells * kCell_px;
  const int left = block_column * kBlock_px;
  const int top = block_row * kBlock_px;
  const cv::Rect inner(kPadding_px, kPadding_px, std::min(kBlock_px, width_px_ - left),
                       std::min(kBlock_px, height_px_ - top));
  const cv::Mat drawn =
      Draw(picture_, pitch_texels_, {width_px_, height_px_},
           {left - kPadding_px, top - kPadding_px, inner.width + 2 * kPadding_px, inner.height + 2 * kPadding_px});
  const cv::Ptr<cv::ORB> orb = MakeDetector();
  std::vector<cv::KeyPoint> corners;
  orb->detect(drawn, corners);
  Thin(corners, inner, kBlockCells);
  cv::Mat descriptors;
  if (!corners.empty()) orb->compute(drawn, corners, descriptors);

  constexpr float kRadians = std::numbers::pi_v<float> / 180.0F;
  const auto pitch_texels = static_cast<float>(pitch_texels_);
  block.corners.reserve(corners.size());
  for (size_t i = 0; i < corners.size(); ++i) {
    const cv::KeyPoint& corner = corners[i];
    TextureCorner& added = block.corners.emplace_back();
    added.x_texels = (corner.pt.x + static_cast<float>(left - kPadding_px) + 0.5F) * pitch_texels;
    added.y_texels = (corner.pt.y + static_cast<float>(top - kPadding_px) + 0.5F) * pitch_texels;
    added.angle = corner.angle * kRadians;
    added.response = corner.response;
    added.descriptor = OrbDescriptor::FromBytes(descriptors.ptr<uint8_t>(static_cast<int>(i)));
    ++block.cell_start[static_cast<size_t>(corner.class_id) + 1];
  }
  for (size_t cell = 1; cell < block.cell_start.size(); ++cell) block.cell_start[cell] += block.cell_start[cell - 1];
}

TextureCorners::TextureCorners(const TexturePicture& picture) {
  const double stretch = std::exp(picture.log_aspect / 2);
  width_texels_ = std::max(1, static_cast<int>(std::lround(picture.texture->width() * stretch)));
  height_texels_ = std::max(1, static_cast<int>(std::lround(picture.texture->height() / stretch)));
  for (double pitch_texels = 1;; pitch_texels *= static_cast<double>(kPyramidScale)) {
    const auto width_px = static_cast<int>(std::lround(width_texels_ / pitch_texels));
    const auto height_px = static_cast<int>(std::lround(height_texels_ / pitch_texels));
    if (std::min(width_px, height_px) < kMinLevelEdge_px) break;
    levels_.emplace_back(picture, pitch_texels, width_px, height_px);
  }
}

}  // namespace mapp::sim
