#pragma once

#include <cstddef>
#include <optional>
#include <span>
#include <vector>

namespace mapp {

/// Figures of a set of values; all 0 for an empty one, which `count` tells.
struct Summary {
  size_t count = 0;
  double mean = 0;
  double rms = 0;  ///< root of the mean square: the RMSE, when the values are errors
  double median = 0;
  double p95 = 0;  ///< nearest rank
  double max = 0;
};
Summary Summarize(std::span<const double> values);

/// Absent without values.
std::optional<double> Mean(std::span<const double> values);
std::optional<double> RootMeanSquare(std::span<const double> values);
/// The middle value; the mean of the two middle ones when their number is even.
std::optional<double> Median(std::vector<double> values);
/// Nearest rank: the smallest value that at least `ratio` of the values do not exceed; `ratio` in (0, 1].
std::optional<double> Percentile(std::vector<double> values, double ratio);

/// `part / whole`; absent when `whole` is 0. Figures "per keyframe" and shares of nothing are absent, never 0.
std::optional<double> Ratio(double part, double whole);

/// How yes-or-no answers fare against the truth.
struct BinaryScore {
  size_t true_positives = 0;
  size_t false_positives = 0;
  size_t false_negatives = 0;
  size_t true_negatives = 0;

  void Add(bool predicted, bool actual);
  BinaryScore& operator+=(const BinaryScore& other);
  /// Share of the predicted that is so; absent when nothing was predicted.
  std::optional<double> Precision() const;
  /// Share of what is so that was predicted; absent when nothing is so.
  std::optional<double> Recall() const;
  /// Harmonic mean of both, 2 TP / (2 TP + FP + FN); absent when nothing is so and nothing was predicted.
  std::optional<double> F1() const;
  /// Share of what is not so that was predicted all the same.
  std::optional<double> FalsePositiveRate() const;
  size_t total() const { return true_positives + false_positives + false_negatives + true_negatives; }
};

}  // namespace mapp
