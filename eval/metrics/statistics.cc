#include "eval/metrics/statistics.h"

#include <algorithm>
#include <cmath>
#include <numeric>

namespace mapp {

Summary Summarize(std::span<const double> values) {
  Summary summary;
  if (values.empty()) return summary;
  std::vector<double> copy(values.begin(), values.end());
  summary.count = values.size();
  summary.mean = *Mean(values);
  summary.rms = *RootMeanSquare(values);
  summary.max = *std::ranges::max_element(values);
  summary.p95 = *Percentile(copy, 0.95);
  summary.median = *Median(std::move(copy));
  return summary;
}

std::optional<double> Mean(std::span<const double> values) {
  return Ratio(std::accumulate(values.begin(), values.end(), 0.0), static_cast<double>(values.size()));
}

std::optional<double> RootMeanSquare(std::span<const double> values) {
  if (values.empty()) return std::nullopt;
  const double sum_squares = std::inner_product(values.begin(), values.end(), values.begin(), 0.0);
  return std::sqrt(sum_squares / static_cast<double>(values.size()));
}

std::optional<double> Median(std::vector<double> values) {
  if (values.empty()) return std::nullopt;
  const auto upper = values.begin() + static_cast<std::ptrdiff_t>(values.size() / 2);
  std::nth_element(values.begin(), upper, values.end());
  if (values.size() % 2 == 1) return *upper;
  return (*std::max_element(values.begin(), upper) + *upper) / 2;
}

std::optional<double> Percentile(std::vector<double> values, double ratio) {
  if (values.empty()) return std::nullopt;
  const auto rank = static_cast<size_t>(std::ceil(ratio * static_cast<double>(values.size())));
  const auto nth = values.begin() + static_cast<std::ptrdiff_t>(std::clamp<size_t>(rank, 1, values.size()) - 1);
  std::nth_element(values.begin(), nth, values.end());
  return *nth;
}

std::optional<double> Ratio(double part, double whole) {
  if (whole == 0) return std::nullopt;
  return part / whole;
}

void BinaryScore::Add(bool predicted, bool actual) {
  if (predicted) {
    ++(actual ? true_positives : false_positives);
  } else {
    ++(actual ? false_negatives : true_negatives);
  }
}

BinaryScore& BinaryScore::operator+=(const BinaryScore& other) {
  true_positives += other.true_positives;
  false_positives += other.false_positives;
  false_negatives += other.false_negatives;
  true_negatives += other.true_negatives;
  return *this;
}

std::optional<double> BinaryScore::Precision() const {
  return Ratio(static_cast<double>(true_positives), static_cast<double>(true_positives + false_positives));
}

std::optional<double> BinaryScore::Recall() const {
  return Ratio(static_cast<double>(true_positives), static_cast<double>(true_positives + false_negatives));
}

std::optional<double> BinaryScore::F1() const {
  return Ratio(2.0 * static_cast<double>(true_positives),
               static_cast<double>(2 * true_positives + false_positives + false_negatives));
}

std::optional<double> BinaryScore::FalsePositiveRate() const {
  return Ratio(static_cast<double>(false_positives), static_cast<double>(false_positives + true_negatives));
}

}  // namespace mapp
