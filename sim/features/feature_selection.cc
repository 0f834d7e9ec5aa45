#include "sim/features/feature_selection.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <tuple>

namespace mapp::sim {
namespace {

/// As in vision/corner_spreading.cc.
constexpr int kBucket_px = 64;
constexpr double kMaxEvenShares = 2.5;
/// Of the candidates asked for in a batch, more than are still wanted, since some are hidden.
constexpr double kBatchShare = 1.3;
constexpr size_t kMinBatch = 16;

/// A candidate among those of its octave: the best come first.
struct Ranked {
  double score;
  uint64_t landmark;
  size_t idx;
  friend bool operator<(const Ranked& a, const Ranked& b) {
    return std::tuple(-a.score, a.landmark) < std::tuple(-b.score, b.landmark);
  }
};

/// Chooses among the candidates of one octave.
class OctaveSelection {
 public:
  OctaveSelection(const Camera& camera, std::span<const FeatureCandidate> candidates, int octave, size_t quota)
      : candidates_(candidates), quota_(quota) {
    const auto scale = static_cast<double>(OctaveScale(octave));
    width_px_ = camera.width_px / scale;
    height_px_ = camera.height_px / scale;
    scale_ = scale;
    columns_ = std::max(1, static_cast<int>(width_px_) / kBucket_px);
    rows_ = std::max(1, static_cast<int>(height_px_) / kBucket_px);
    const auto num_cells = static_cast<size_t>(columns_ * rows_);
    cell_limit_ =
        std::max(1, static_cast<int>(kMaxEvenShares * static_cast<double>(quota) / static_cast<double>(num_cells)));
    cell_counts_.assign(num_cells, 0);
  }

  /// `order`: the octave's candidates, best first.
  void Run(std::span<const size_t> order, const HiddenTest& hidden, std::vector<size_t>& selected) {
    std::vector<size_t> surplus;          // untested, of full cells
    std::vector<size_t> visible_surplus;  // tested, of cells that filled up meanwhile
    size_t next = 0;
    std::vector<size_t> batch;
    while (num_selected_ < quota_ && next < order.size()) {
      batch.clear();
      const size_t batch_size = BatchSize();
      for (; next < order.size() && batch.size() < batch_size; ++next) {
        (CellCount(order[next]) < cell_limit_ ? batch : surplus).push_back(order[next]);
      }
      const std::vector<uint8_t> is_hidden = hidden(batch);
      for (size_t i = 0; i < batch.size() && num_selected_ < quota_; ++i) {
        if (is_hidden[i] != 0) continue;
        if (CellCount(batch[i]) >= cell_limit_) {
          visible_surplus.push_back(batch[i]);
          continue;
        }
        ++CellCount(batch[i]);
        Take(batch[i], selected);
      }
    }
    for (size_t i = 0; i < visible_surplus.size() && num_selected_ < quota_; ++i) Take(visible_surplus[i], selected);
    for (size_t first = 0; num_selected_ < quota_ && first < surplus.size();) {
      batch.assign(surplus.begin() + static_cast<ptrdiff_t>(first),
                   surplus.begin() + static_cast<ptrdiff_t>(std::min(surplus.size(), first + BatchSize())));
      first += batch.size();
      const std::vector<uint8_t> is_hidden = hidden(batch);
      for (size_t i = 0; i < batch.size() && num_selected_ < quota_; ++i) {
        if (is_hidden[i] == 0) Take(batch[i], selected);
      }
    }
  }

 private:
  size_t BatchSize() const {
    return kMinBatch + static_cast<size_t>(kBatchShare * static_cast<double>(quota_ - num_selected_));
  }
  int& CellCount(size_t candidate) {
    const Eigen::Vector2d at = candidates_[candidate].pixel / scale_;
    const int column = std::clamp(static_cast<int>(at.x() * columns_ / width_px_), 0, columns_ - 1);
    const int row = std::clamp(static_cast<int>(at.y() * rows_ / height_px_), 0, rows_ - 1);
    return cell_counts_[static_cast<size_t>(row * columns_ + column)];
  }
  void Take(size_t candidate, std::vector<size_t>& selected) {
    selected.push_back(candidate);
    ++num_selected_;
  }

  std::span<const FeatureCandidate> candidates_;
  size_t quota_;
  size_t num_selected_ = 0;
  double width_px_, height_px_, scale_;
  int columns_, rows_, cell_limit_;
  std::vector<int> cell_counts_;
};

}  // namespace

std::vector<size_t> SelectFeatures(const Camera& camera, std::span<const FeatureCandidate> candidates,
                                   std::span<const double> scores, int num_features, const HiddenTest& hidden) {
  std::array<std::vector<Ranked>, kPyramidLevels> octaves;
  for (std::vector<Ranked>& ranked : octaves) ranked.reserve(candidates.size() / 4);
  for (size_t i = 0; i < candidates.size(); ++i) {
    octaves[static_cast<size_t>(candidates[i].octave)].push_back({scores[i], candidates[i].landmark, i});
  }
  std::vector<size_t> order;
  std::vector<size_t> selected;
  selected.reserve(static_cast<size_t>(num_features));
  double remaining_weight = 0;
  for (int octave = 0; octave < kPyramidLevels; ++octave)
    remaining_weight += 1.0 / static_cast<double>(OctaveScale(octave));
  for (int octave = 0; octave < kPyramidLevels; ++octave) {
    const double weight = 1.0 / static_cast<double>(OctaveScale(octave));
    const int remaining = num_features - static_cast<int>(selected.size());
    const auto quota = static_cast<size_t>(std::max(0L, std::lround(remaining * weight / remaining_weight)));
    remaining_weight -= weight;
    std::vector<Ranked>& ranked = octaves[static_cast<size_t>(octave)];
    std::sort(ranked.begin(), ranked.end());
    order.clear();
    for (const Ranked& candidate : ranked) order.push_back(candidate.idx);
    OctaveSelection(camera, candidates, octave, quota).Run(order, hidden, selected);
  }
  return selected;
}

}  // namespace mapp::sim
