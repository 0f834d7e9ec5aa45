#include "mapp/view/seen_geometry.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <unordered_set>
#include <utility>

namespace mapp {
namespace {

/// Own points next to a ray that are asked how far it goes, and how many of them must lie beyond the place.
constexpr size_t kNumAround = 3;
constexpr size_t kMinBeyond = 2;
/// Cells a side at most: rays that are almost at right angles to the axis are looked up in the border's cells.
constexpr float kMaxTangent = 4;

}  // namespace

SeenGeometry::SeenGeometry(std::vector<Eigen::Vector3f> p_camera, const SightingOptions& options)
    : options_(options), p_camera_(std::move(p_camera)) {
  if (p_camera_.empty()) return;
  std::vector<Entry> unsorted;
  float max_x = -kMaxTangent, max_y = -kMaxTangent;
  min_x_ = min_y_ = kMaxTangent;
  for (const Eigen::Vector3f& p : p_camera_) {
    const Entry entry{p.x() / p.z(), p.y() / p.z(), 0.5F * std::log(p.z()), p.z()};
    unsorted.push_back(entry);
    farthest_depth_m_ = std::max(farthest_depth_m_, p.z());
    min_x_ = std::min(min_x_, entry.x);
    min_y_ = std::min(min_y_, entry.y);
    max_x = std::max(max_x, entry.x);
    max_y = std::max(max_y, entry.y);
  }
  min_x_ = std::max(min_x_, -kMaxTangent);
  min_y_ = std::max(min_y_, -kMaxTangent);
  const float cell = options_.ray_radius;
  num_cols_ = static_cast<int>((std::min(max_x, kMaxTangent) - min_x_) / cell) + 1;
  num_rows_ = static_cast<int>((std::min(max_y, kMaxTangent) - min_y_) / cell) + 1;
  const auto cell_of = [&](const Entry& entry) {
    const int col = std::clamp(static_cast<int>((entry.x - min_x_) / cell), 0, num_cols_ - 1);
    const int row = std::clamp(static_cast<int>((entry.y - min_y_) / cell), 0, num_rows_ - 1);
    return static_cast<size_t>(row) * num_cols_ + col;
  };
  cell_begin_.assign(static_cast<size_t>(num_cols_) * num_rows_ + 1, 0);
  for (const Entry& entry : unsorted) ++cell_begin_[cell_of(entry) + 1];
  for (size_t i = 1; i < cell_begin_.size(); ++i) cell_begin_[i] += cell_begin_[i - 1];
  entries_.resize(unsorted.size());
  std::vector<uint32_t> next(cell_begin_.begin(), cell_begin_.end() - 1);
  for (const Entry& entry : unsorted) entries_[next[cell_of(entry)]++] = entry;
}

template <typename Visit>
void SeenGeometry::VisitNear(float x, float y, float radius, const Visit& visit) const {
  const float cell = options_.ray_radius;
  const int first_col = std::max(0, static_cast<int>(std::floor((x - radius - min_x_) / cell)));
  const int last_col = std::min(num_cols_ - 1, static_cast<int>(std::floor((x + radius - min_x_) / cell)));
  const int first_row = std::max(0, static_cast<int>(std::floor((y - radius - min_y_) / cell)));
  const int last_row = std::min(num_rows_ - 1, static_cast<int>(std::floor((y + radius - min_y_) / cell)));
  for (int row = first_row; row <= last_row; ++row) {
    // Cells of a row follow each other, and so do their entries.
    const size_t base = static_cast<size_t>(row) * num_cols_;
    if (first_col > last_col) return;
    const uint32_t end = cell_begin_[base + last_col + 1];
    for (uint32_t i = cell_begin_[base + first_col]; i < end; ++i) {
      if (!visit(entries_[i])) return;
    }
  }
}

SurfaceSighting SeenGeometry::At(const Eigen::Vector3f& p_camera) const {
  if (p_camera.z() <= 0) return SurfaceSighting::kUnknown;
  if (entries_.empty()) return SurfaceSighting::kEmpty;
  const float x = p_camera.x() / p_camera.z(), y = p_camera.y() / p_camera.z();
  const float half_ln_z = 0.5F * std::log(p_camera.z());
  const float match_radius = options_.match_radius;
  bool seen = false;
  // The own points next to the ray, by their distance to it.
  std::array<std::pair<float, float>, kNumAround> around;  // squared distance, depth relative to the place
  size_t num_around = 0;
  VisitNear(x, y, options_.ray_radius, [&](const Entry& entry) {
    const Eigen::Vector2f offset(entry.x - x, entry.y - y);
    const float lateral = offset.squaredNorm();
    const float along = entry.half_ln_z - half_ln_z;
    if (lateral + along * along < match_radius * match_radius) {
      seen = true;
      return false;
    }
    if (lateral >= options_.ray_radius * options_.ray_radius) return true;
    if (num_around < around.size()) {
      around[num_around++] = {lateral, along};
    } else if (lateral < around.back().first) {
      around.back() = {lateral, along};
    } else {
      return true;
    }
    for (size_t i = num_around - 1; i > 0 && around[i].first < around[i - 1].first; --i) {
      std::swap(around[i], around[i - 1]);
    }
    return true;
  });
  if (seen) return SurfaceSighting::kSeen;
  if (num_around == 0) return SurfaceSighting::kEmpty;
  size_t num_beyond = 0;
  for (size_t i = 0; i < num_around; ++i) {
    if (around[i].second < -match_radius) return SurfaceSighting::kUnknown;  // something nearer may hide it
    num_beyond += around[i].second > match_radius ? 1 : 0;
  }
  return num_beyond >= kMinBeyond ? SurfaceSighting::kMissed : SurfaceSighting::kUnknown;
}

std::vector<Eigen::Vector3f> OwnFeaturePoints(const Keyframe& keyframe, const Camera& camera, double scale) {
  std::vector<Eigen::Vector3f> p_camera;
  for (const KeyframeFeature& feature : keyframe.features) {
    if (!feature.point) continue;
    const Eigen::Vector2d pixel(feature.keypoint.u_px, feature.keypoint.v_px);
    p_camera.push_back((scale * feature.point->depth_m * camera.Unproject(pixel)).cast<float>());
  }
  return p_camera;
}

std::vector<Eigen::Vector3f> OwnSurfacePoints(const Keyframe& keyframe, const Camera& camera, double scale) {
  std::vector<Eigen::Vector3f> p_camera = OwnFeaturePoints(keyframe, camera, scale);
  if (!keyframe.raster) return p_camera;
  std::unordered_set<uint32_t> own_cells;
  for (const KeyframeFeature& feature : keyframe.features) {
    if (feature.point) own_cells.insert(RasterCellOf(camera, {feature.keypoint.u_px, feature.keypoint.v_px}));
  }
  for (const auto& [cell, depth_m] : keyframe.raster->samples) {
    if (own_cells.contains(cell)) continue;
    p_camera.push_back((scale * depth_m * camera.Unproject(RasterCellCenter(camera, cell))).cast<float>());
  }
  return p_camera;
}

}  // namespace mapp
