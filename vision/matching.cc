#include "vision/matching.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <limits>
#include <numbers>

namespace mapp {
namespace {

constexpr int kNoDistance = std::numeric_limits<int>::max();
constexpr int kNoIndex = -1;

/// The two nearest of the candidates shown to it; the first shown wins a tie.
struct TwoNearest {
  int best_idx = kNoIndex;
  int best_distance = kNoDistance;
  int second_distance = kNoDistance;

  void Add(int idx, int distance) {
    if (distance < best_distance) {
      second_distance = best_distance;
      best_distance = distance;
      best_idx = idx;
    } else if (distance < second_distance) {
      second_distance = distance;
    }
  }
};

bool PassesRatio(int best, int second, double max_ratio) {
  if (max_ratio >= 1.0 || second == kNoDistance) return true;
  return best < max_ratio * second;
}

TwoNearest FindTwoNearest(const OrbDescriptor& query, std::span<const OrbDescriptor> train) {
  TwoNearest nearest;
  for (size_t i = 0; i < train.size(); ++i) nearest.Add(static_cast<int>(i), HammingDistance(query, train[i]));
  return nearest;
}

}  // namespace

std::vector<Match> MatchDescriptors(std::span<const OrbDescriptor> query, std::span<const OrbDescriptor> train,
                                    const MatchOptions& options) {
  std::vector<Match> matches;
  for (size_t i = 0; i < query.size(); ++i) {
    const TwoNearest nearest = FindTwoNearest(query[i], train);
    if (nearest.best_idx == kNoIndex || nearest.best_distance > options.max_distance) continue;
    if (!PassesRatio(nearest.best_distance, nearest.second_distance, options.max_ratio)) continue;
    // Asked backwards only for pairs that passed so far: cheaper than the whole second direction.
    if (options.mutual &&
        FindTwoNearest(train[static_cast<size_t>(nearest.best_idx)], query).best_idx != static_cast<int>(i)) {
      continue;
    }
    matches.push_back({static_cast<int>(i), nearest.best_idx, nearest.best_distance});
  }
  return matches;
}

FeatureGrid::FeatureGrid(std::span<const Point> points, int width_px, int height_px, int cell_px)
    : points_(points.begin(), points.end()),
      cell_px_(std::max(1, cell_px)),
      columns_(std::max(1, (width_px + cell_px_ - 1) / cell_px_)),
      rows_(std::max(1, (height_px + cell_px_ - 1) / cell_px_)) {
  // Points outside the image (undistortion moves some there) are kept in the border cells. Counting sort by cell.
  const auto cell_of = [this](const Point& point) {
    const float column = std::clamp(point.u_px / static_cast<float>(cell_px_), 0.0F, static_cast<float>(columns_ - 1));
    const float row = std::clamp(point.v_px / static_cast<float>(cell_px_), 0.0F, static_cast<float>(rows_ - 1));
    return static_cast<size_t>(static_cast<int>(row) * columns_ + static_cast<int>(column));
  };
  const auto is_finite = [](const Point& point) { return std::isfinite(point.u_px) && std::isfinite(point.v_px); };
  cell_start_.assign(static_cast<size_t>(columns_) * static_cast<size_t>(rows_) + 1, 0);
  for (const Point& point : points_) {
    if (is_finite(point)) ++cell_start_[cell_of(point) + 1];
  }
  for (size_t cell = 1; cell < cell_start_.size(); ++cell) cell_start_[cell] += cell_start_[cell - 1];
  cell_items_.resize(static_cast<size_t>(cell_start_.back()));
  std::vector<int> next(cell_start_.begin(), cell_start_.end() - 1);
  for (size_t i = 0; i < points_.size(); ++i) {
    if (!is_finite(points_[i])) continue;
    cell_items_[static_cast<size_t>(next[cell_of(points_[i])]++)] = static_cast<int>(i);
  }
}

void FeatureGrid::Find(float u_px, float v_px, float radius_px, std::vector<int>& out) const {
  if (cell_items_.empty() || !std::isfinite(u_px) || !std::isfinite(v_px) || !(radius_px >= 0)) return;
  const auto to_cell = [this](float px, int count) {
    return static_cast<int>(std::clamp(px / static_cast<float>(cell_px_), 0.0F, static_cast<float>(count - 1)));
  };
  const int first_column = to_cell(u_px - radius_px, columns_);
  const int last_column = to_cell(u_px + radius_px, columns_);
  const int first_row = to_cell(v_px - radius_px, rows_);
  const int last_row = to_cell(v_px + radius_px, rows_);
  for (int row = first_row; row <= last_row; ++row) {
    // The cells of one row are adjacent in the item list.
    const auto begin = static_cast<size_t>(cell_start_[static_cast<size_t>(row * columns_ + first_column)]);
    const auto end = static_cast<size_t>(cell_start_[static_cast<size_t>(row * columns_ + last_column + 1)]);
    for (size_t i = begin; i < end; ++i) {
      const Point& point = points_[static_cast<size_t>(cell_items_[i])];
      if (std::abs(point.u_px - u_px) <= radius_px && std::abs(point.v_px - v_px) <= radius_px) {
        out.push_back(cell_items_[i]);
      }
    }
  }
}

namespace {

/// Nearest feature among the candidates, or none when it fails the distance or the ratio test.
TwoNearest NearestOfOctaves(const ProjectedPoint& point, std::span<const int> candidates,
                            std::span<const Feature> features, const MatchOptions& options) {
  std::array<TwoNearest, 3> by_octave;  // octave - 1, octave, octave + 1
  for (const int idx : candidates) {
    const Feature& feature = features[static_cast<size_t>(idx)];
    const int offset = feature.keypoint.octave - point.octave + 1;
    if (offset < 0 || offset > 2) continue;
    by_octave[static_cast<size_t>(offset)].Add(idx, HammingDistance(point.descriptor, feature.descriptor));
  }
  // The same corner is often found on neighboring levels too: only rivals of the winner's level speak against it.
  const TwoNearest& winner = *std::min_element(by_octave.begin(), by_octave.end(), [](const auto& a, const auto& b) {
    return a.best_distance < b.best_distance;
  });
  if (winner.best_idx == kNoIndex || winner.best_distance > options.max_distance) return {};
  if (!PassesRatio(winner.best_distance, winner.second_distance, options.max_ratio)) return {};
  return winner;
}

}  // namespace

std::vector<Match> MatchProjected(std::span<const ProjectedPoint> projected, const FeatureGrid& grid,
                                  std::span<const Feature> features, const MatchOptions& options) {
  std::vector<Match> proposals;
  std::vector<int> owner(features.size(), kNoIndex);  // index into proposals
  std::vector<int> candidates;
  for (size_t i = 0; i < projected.size(); ++i) {
    candidates.clear();
    grid.Find(projected[i].u_px, projected[i].v_px, projected[i].radius_px, candidates);
    const TwoNearest nearest = NearestOfOctaves(projected[i], candidates, features, options);
    if (nearest.best_idx == kNoIndex) continue;
    int& owner_idx = owner[static_cast<size_t>(nearest.best_idx)];
    if (owner_idx != kNoIndex && proposals[static_cast<size_t>(owner_idx)].distance <= nearest.best_distance) continue;
    owner_idx = static_cast<int>(proposals.size());
    proposals.push_back({static_cast<int>(i), nearest.best_idx, nearest.best_distance});
  }
  std::vector<Match> matches;
  matches.reserve(proposals.size());
  for (size_t i = 0; i < proposals.size(); ++i) {
    if (owner[static_cast<size_t>(proposals[i].train_idx)] == static_cast<int>(i)) matches.push_back(proposals[i]);
  }
  return matches;
}

std::vector<Match> FilterByRotation(const std::vector<Match>& matches, std::span<const Feature> query,
                                    std::span<const Feature> train) {
  constexpr int kNumBins = 30;
  constexpr float kTurn = 2.0F * std::numbers::pi_v<float>;
  // Lesser bins count only when at least a tenth of the fullest: else they are noise (Mur-Artal et al. 2015).
  constexpr double kMinShareOfFullest = 0.1;
  std::array<int, kNumBins> counts{};
  std::vector<size_t> bins(matches.size());
  for (size_t i = 0; i < matches.size(); ++i) {
    const float turn = query[static_cast<size_t>(matches[i].query_idx)].keypoint.angle -
                       train[static_cast<size_t>(matches[i].train_idx)].keypoint.angle;
    const float share = turn / kTurn - std::floor(turn / kTurn);
    bins[i] = static_cast<size_t>(std::lround(share * kNumBins)) % kNumBins;
    ++counts[bins[i]];
  }
  std::array<size_t, kNumBins> order{};
  for (size_t bin = 0; bin < kNumBins; ++bin) order[bin] = bin;
  std::stable_sort(order.begin(), order.end(), [&](size_t a, size_t b) { return counts[a] > counts[b]; });
  std::array<bool, kNumBins> accepted{};
  for (size_t rank = 0; rank < 3; ++rank) {
    const size_t bin = order[rank];
    accepted[bin] = counts[bin] > 0 && counts[bin] >= kMinShareOfFullest * counts[order[0]];
  }
  std::vector<Match> kept;
  kept.reserve(matches.size());
  for (size_t i = 0; i < matches.size(); ++i) {
    if (accepted[bins[i]]) kept.push_back(matches[i]);
  }
  return kept;
}

int PredictOctave(float reference_distance_m, float distance_m) {
  const float ratio = reference_distance_m / distance_m;
  if (!(ratio > 1.0F)) return 0;
  const float octave = std::log(ratio) / std::log(kPyramidScale);
  return static_cast<int>(std::lround(std::min(octave, static_cast<float>(kPyramidLevels - 1))));
}

size_t RepresentativeDescriptor(std::span<const OrbDescriptor> descriptors) {
  if (descriptors.size() < 3) return 0;
  std::vector<int> distances(descriptors.size());
  size_t best_idx = 0;
  int best_median = kNoDistance;
  for (size_t i = 0; i < descriptors.size(); ++i) {
    for (size_t j = 0; j < descriptors.size(); ++j) distances[j] = HammingDistance(descriptors[i], descriptors[j]);
    const auto median = distances.begin() + static_cast<ptrdiff_t>(distances.size() / 2);
    std::nth_element(distances.begin(), median, distances.end());
    if (*median < best_median) {
      best_median = *median;
      best_idx = i;
    }
  }
  return best_idx;
}

}  // namespace mapp
