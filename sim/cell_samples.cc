#include "sim/cell_samples.h"

#include "sim/four.h"

#include <algorithm>

namespace mapp::sim {
namespace {

/// Four values from `first` on.
template <typename Values>
Eigen::Map<Eigen::Array4f, Eigen::Aligned16> Four(Values& values, size_t first) {
  return Eigen::Map<Eigen::Array4f, Eigen::Aligned16>(&values[first]);
}

}  // namespace

/// A cell at the image's border repeats its last pixels.
void CellSamples::Begin(int x, int y) {
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
  slots_.fill(kSky);
  views_.clear();
}

void CellSamples::Resolve(const CellGrid::Candidates& candidates) {
  views_.assign(candidates.views().begin(), candidates.views().end());
  ChooseNearest(0);
  CastWhereSky(0, kNumPadded);
}

void CellSamples::Cast() {
  CastWhereSky(0, kNumCenters);
  ChooseNearest(kNumCenters);
  CastWhereSky(kNumCenters, kNumPadded);
}

void CellSamples::ChooseNearest(size_t begin) {
  alignas(16) std::array<float, kNumPadded> nearest{};
  for (size_t slot = 0; slot < views_.size(); ++slot) {
    const QuadHit hit(caster_.views()[static_cast<size_t>(views_[slot])], {x_[0], y_[0]});
    for (size_t first = begin; first < kNumPadded; first += kSize) {
      const Eigen::Array4f inverse_depth = hit.InverseDepth(RowAt(first).rays);
      auto best = Four(nearest, first);
      auto slots = Four(slots_, first);
      slots = Select(AreGreater(inverse_depth, best), Eigen::Array4f::Constant(static_cast<float>(slot)), slots);
      best = best.max(inverse_depth);
    }
  }
}

void CellSamples::CastWhereSky(size_t begin, size_t end) {
  std::array<size_t, kNumPadded> samples;
  std::array<Eigen::Vector2f, kNumPadded> rays;
  std::array<int32_t, kNumPadded> views;
  size_t count = 0;
  for (size_t i = begin; i < end; ++i) {
    if (slots_[i] >= 0) continue;
    samples[count] = i;
    rays[count++] = {x_[i], y_[i]};
  }
  if (count == 0) return;
  caster_.Cast({rays.data(), count}, {views.data(), count});
  for (size_t i = 0; i < count; ++i) slots_[samples[i]] = static_cast<float>(SlotOf(views[i]));
}

int CellSamples::SlotOf(int32_t view) {
  if (view == kNoView) return kSky;
  const auto known = std::ranges::find(views_, view);
  const auto slot = static_cast<int>(known - views_.begin());
  if (known == views_.end()) views_.push_back(view);
  return slot;
}

std::optional<int32_t> CellSamples::OnlyView() const {
  if (std::ranges::any_of(slots_, [&](float slot) { return slot != slots_[0]; })) return std::nullopt;
  return slots_[0] < 0 ? kNoView : views_[static_cast<size_t>(slots_[0])];
}

CellSamples::Seen CellSamples::At(int slot) const {
  Seen seen{views_[static_cast<size_t>(slot)], std::nullopt};
  const auto sample = std::ranges::find(slots_, static_cast<float>(slot));
  if (sample != slots_.end()) {
    const auto i = static_cast<size_t>(sample - slots_.begin());
    seen.ray = {x_[i], y_[i]};
  }
  return seen;
}

}  // namespace mapp::sim
