#include "sim/cell_samples.h"

#include <algorithm>

namespace mapp::sim {
namespace {

/// Four values from `first` on.
template <typename Values>
Eigen::Map<Eigen::Array4f> Four(Values& values, size_t first) {
  return Eigen::Map<Eigen::Array4f>(&values[first]);
}

}  // namespace

void CellSurfaces::Begin(const Eigen::Vector2f& ray_per_x, const Eigen::Vector2f& ray_per_y) {
  ray_per_x_ = ray_per_x;
  ray_per_y_ = ray_per_y;
  known_.clear();
}

int CellSurfaces::SlotOf(int32_t view, const Eigen::Vector2f& ray) {
  if (view == kNoView) return kSky;
  for (size_t i = 0; i < known_.size(); ++i) {
    if (known_[i].first == view) return static_cast<int>(i);
  }
  known_.emplace_back(view, SurfacePatch(views_[static_cast<size_t>(view)], ray, ray_per_x_, ray_per_y_));
  return static_cast<int>(known_.size()) - 1;
}

/// A cell at the image's border repeats its last pixels.
void CellSamples::Place(int x, int y) {
  for (int line = 0; line < kSize; ++line) {
    const RayRow row = table_.CenterRow(x, std::min(y + line, table_.height() - 1));
    Four(x_, static_cast<size_t>(line * kSize)) = row.x;
    Four(y_, static_cast<size_t>(line * kSize)) = row.y;
  }
  size_t next = kNumCenters;
  for (int line = 0; line < kLine; ++line) {
    for (int column = 0; column < kLine; ++column, ++next) {
      const Eigen::Vector2f ray =
          table_.Corner(std::min(x + column, table_.width()), std::min(y + line, table_.height()));
      x_[next] = ray.x();
      y_[next] = ray.y();
    }
  }
  for (; next < kNumPadded; ++next) {
    x_[next] = x_[next - 1];
    y_[next] = y_[next - 1];
  }
}

bool CellSamples::AllMeet(int32_t view, int x, int y) {
  Place(x, y);
  std::array<Eigen::Vector2f, kNumCenters> rays;
  for (size_t i = 0; i < rays.size(); ++i) rays[i] = RayAt(i);
  caster_.Cast(rays, center_views_);
  return std::ranges::all_of(center_views_, [&](int32_t met) { return met == view; });
}

void CellSamples::Resolve(const std::array<int32_t, 4>& corner_views, CellSurfaces& surfaces) {
  constexpr std::array<size_t, 4> kCornerSamples = {kNumCenters, kNumCenters + kSize, kNumCenters + kSize * kLine,
                                                    kNumCenters + kSize * kLine + kSize};
  for (size_t i = 0; i < kNumCenters; ++i) {
    slots_[i] = static_cast<float>(surfaces.SlotOf(center_views_[i], RayAt(i)));
  }
  for (size_t i = 0; i < kCornerSamples.size(); ++i) surfaces.SlotOf(corner_views[i], RayAt(kCornerSamples[i]));

  bool all_resolved = true;
  for (size_t first = kNumCenters; first < kNumPadded; first += kSize) {
    const RayRow rays = RowAt(first).rays;
    Eigen::Array4f nearest = Eigen::Array4f::Zero();
    Eigen::Array4f slots = Eigen::Array4f::Constant(CellSurfaces::kSky);
    for (int slot = 0; slot < surfaces.size(); ++slot) {
      const Eigen::Array4f inverse_depth = surfaces[slot].InverseDepthIfMet(rays);
      slots = (inverse_depth > nearest).select(static_cast<float>(slot), slots);
      nearest = nearest.max(inverse_depth);
    }
    Four(slots_, first) = slots;
    all_resolved = all_resolved && nearest.minCoeff() > 0;
  }
  if (!all_resolved) CastUnresolvedCorners(surfaces);
}

/// Corners that meet none of the cell's surfaces see the sky, or something that no centre sees.
void CellSamples::CastUnresolvedCorners(CellSurfaces& surfaces) {
  constexpr size_t kNumCorners = kNumSamples - kNumCenters;
  std::array<size_t, kNumCorners> samples;
  std::array<Eigen::Vector2f, kNumCorners> rays;
  std::array<int32_t, kNumCorners> views;
  size_t count = 0;
  for (size_t i = kNumCenters; i < kNumSamples; ++i) {
    if (slots_[i] >= 0) continue;
    samples[count] = i;
    rays[count++] = RayAt(i);
  }
  caster_.Cast({rays.data(), count}, {views.data(), count});
  for (size_t i = 0; i < count; ++i) slots_[samples[i]] = static_cast<float>(surfaces.SlotOf(views[i], rays[i]));
}

CellSamples::Row CellSamples::RowAt(size_t first) const {
  using Values = Eigen::Map<const Eigen::Array4f>;
  return {{Values(&x_[first]), Values(&y_[first])}, Values(&slots_[first])};
}

}  // namespace mapp::sim
