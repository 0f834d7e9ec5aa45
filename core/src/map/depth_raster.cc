#include "mapp/map/depth_raster.h"

#include <fmt/format.h>

#include <algorithm>

namespace mapp {
namespace {

uint32_t NumCells(int side_px) {
  return static_cast<uint32_t>((side_px + DepthRaster::kCellPx - 1) / DepthRaster::kCellPx);
}

/// The image begins half a pixel before the first pixel's centre.
uint32_t CellAlong(double coordinate_px, int side_px) {
  const int cell = static_cast<int>((coordinate_px + 0.5) / DepthRaster::kCellPx);
  return static_cast<uint32_t>(std::clamp(cell, 0, static_cast<int>(NumCells(side_px)) - 1));
}

}  // namespace

uint32_t NumRasterCells(const Camera& camera) { return NumCells(camera.width_px) * NumCells(camera.height_px); }

uint32_t RasterCellOf(const Camera& camera, const Eigen::Vector2d& pixel) {
  return CellAlong(pixel.y(), camera.height_px) * NumCells(camera.width_px) + CellAlong(pixel.x(), camera.width_px);
}

Eigen::Vector2d RasterCellCenter(const Camera& camera, uint32_t cell) {
  const uint32_t num_cols = NumCells(camera.width_px);
  constexpr double kHalf = 0.5;
  const Eigen::Vector2d center((cell % num_cols + kHalf) * DepthRaster::kCellPx - kHalf,
                               (cell / num_cols + kHalf) * DepthRaster::kCellPx - kHalf);
  return center.cwiseMin(Eigen::Vector2d(camera.width_px - 1, camera.height_px - 1));
}

void DepthRasterizer::Add(const Eigen::Vector2d& pixel, float depth_m) {
  if (!(depth_m >= DepthRaster::kMinDepthM && depth_m <= DepthRaster::kMaxDepthM)) return;
  const auto [entry, is_new] = nearest_m_.try_emplace(RasterCellOf(camera_, pixel), depth_m);
  if (!is_new) entry->second = std::min(entry->second, depth_m);
}

DepthRaster DepthRasterizer::Finish() const {
  DepthRaster raster;
  for (const auto& [cell, depth_m] : nearest_m_) raster.samples.push_back({cell, depth_m});
  return raster;
}

Status Validate(const DepthRaster& raster, const Camera& camera) {
  const uint32_t num_cells = NumRasterCells(camera);
  for (size_t i = 0; i < raster.samples.size(); ++i) {
    const auto& [cell, depth_m] = raster.samples[i];
    if (cell >= num_cells || (i > 0 && cell <= raster.samples[i - 1].cell)) {
      return absl::InvalidArgumentError(fmt::format(
          "keyframe.raster[{}].cell: must ascend and be below the image's {} squares, got {}", i, num_cells, cell));
    }
    if (!(depth_m >= DepthRaster::kMinDepthM && depth_m <= DepthRaster::kMaxDepthM)) {
      return absl::InvalidArgumentError(fmt::format("keyframe.raster[{}].depth_m: must be in [{}, {}], got {}", i,
                                                    DepthRaster::kMinDepthM, DepthRaster::kMaxDepthM, depth_m));
    }
  }
  return absl::OkStatus();
}

}  // namespace mapp
