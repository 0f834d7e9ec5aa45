#include "mapp/view/depth_sketch.h"

#include <algorithm>
#include <cmath>
#include <vector>

namespace mapp {
namespace {

constexpr double kNearestM = 0.1;
const double kLnSpan = std::log(1000.0);  // 0.1 m to 100 m
constexpr double kSteps = 254.0;

/// Value below which `share` of the sorted values lie, nearest rank.
double Percentile(const std::vector<double>& sorted, double share) {
  const auto rank = static_cast<size_t>(std::lround(share * static_cast<double>(sorted.size() - 1)));
  return sorted[rank];
}

}  // namespace

uint8_t DepthSketch::EncodeDepth(double depth_m) {
  return static_cast<uint8_t>(std::lround(std::clamp(CodeOfDepth(std::max(depth_m, kNearestM)), 1.0, 1 + kSteps)));
}

double DepthSketch::CodeOfDepth(double depth_m) { return 1 + std::log(depth_m / kNearestM) / kLnSpan * kSteps; }

double DepthSketch::DepthOfCode(double code) { return kNearestM * std::exp((code - 1) / kSteps * kLnSpan); }

bool DepthSketch::empty() const {
  return std::all_of(cells.begin(), cells.end(), [](const Cell& cell) { return cell.near_code == 0; });
}

double DepthSketch::FarthestDepth() const {
  uint8_t farthest = 0;
  for (const Cell& cell : cells) farthest = std::max(farthest, cell.far_code);
  return farthest == 0 ? 0 : DecodeDepth(farthest) * std::exp(kLnDepthPadding);
}

DepthSketch MakeDepthSketch(const Camera& camera, std::span<const Eigen::Vector3d> p_camera, SketchRange range) {
  std::array<std::vector<double>, DepthSketch::kCells> depths;
  for (const Eigen::Vector3d& point : p_camera) {
    if (point.z() <= 0) continue;
    const Eigen::Vector2d pixel = camera.Project(point);
    const int column = std::clamp(static_cast<int>((pixel.x() + 0.5) * DepthSketch::kColumns / camera.width_px), 0,
                                  DepthSketch::kColumns - 1);
    const int row = std::clamp(static_cast<int>((pixel.y() + 0.5) * DepthSketch::kRows / camera.height_px), 0,
                               DepthSketch::kRows - 1);
    depths[static_cast<size_t>(row * DepthSketch::kColumns + column)].push_back(point.z());
  }
  DepthSketch sketch;
  for (size_t i = 0; i < depths.size(); ++i) {
    if (depths[i].empty()) continue;
    std::sort(depths[i].begin(), depths[i].end());
    sketch.cells[i] = {DepthSketch::EncodeDepth(Percentile(depths[i], range.near_share)),
                       DepthSketch::EncodeDepth(Percentile(depths[i], range.far_share))};
  }
  return sketch;
}

}  // namespace mapp
