#include "eval/metrics/statistics.h"

#include <gtest/gtest.h>

#include <cmath>
#include <utility>

namespace mapp {
namespace {

TEST(StatisticsTest, NothingHasNoFigures) {
  EXPECT_EQ(Mean({}), std::nullopt);
  EXPECT_EQ(RootMeanSquare({}), std::nullopt);
  EXPECT_EQ(Median({}), std::nullopt);
  EXPECT_EQ(Percentile({}, 0.5), std::nullopt);
  EXPECT_EQ(Ratio(1, 0), std::nullopt);
  EXPECT_EQ(Summarize({}).count, 0);
}

TEST(StatisticsTest, FiguresOfKnownValues) {
  const std::vector<double> values = {4, 1, 3, 2, -10};
  EXPECT_DOUBLE_EQ(*Mean(values), 0);
  EXPECT_DOUBLE_EQ(*RootMeanSquare(values), std::sqrt(130.0 / 5));
  EXPECT_DOUBLE_EQ(*Median(values), 2);
  EXPECT_DOUBLE_EQ(*Median({4, 1, 3, 2}), 2.5);
  EXPECT_DOUBLE_EQ(*Ratio(1, 4), 0.25);
}

TEST(StatisticsTest, PercentilesAreNearestRank) {
  std::vector<double> values;
  for (int i = 100; i >= 1; --i) values.push_back(i);
  for (const auto& [ratio, expected] :
       {std::pair{0.001, 1.0}, {0.01, 1.0}, {0.5, 50.0}, {0.501, 51.0}, {0.95, 95.0}, {1.0, 100.0}}) {
    EXPECT_DOUBLE_EQ(*Percentile(values, ratio), expected) << ratio;
  }
  EXPECT_DOUBLE_EQ(*Percentile({7}, 0.05), 7);
}

TEST(StatisticsTest, SummaryAgreesWithItsParts) {
  const std::vector<double> values = {0.5, 0.25, 2, 1, 0.125, 8};
  const Summary summary = Summarize(values);
  EXPECT_EQ(summary.count, 6);
  EXPECT_DOUBLE_EQ(summary.mean, *Mean(values));
  EXPECT_DOUBLE_EQ(summary.rms, *RootMeanSquare(values));
  EXPECT_DOUBLE_EQ(summary.median, 0.75);
  EXPECT_DOUBLE_EQ(summary.p95, 8);
  EXPECT_DOUBLE_EQ(summary.max, 8);
  EXPECT_DOUBLE_EQ(Summarize(std::vector<double>{-3, -2}).max, -2);
}

BinaryScore Score(size_t tp, size_t fp, size_t fn, size_t tn) {
  return {.true_positives = tp, .false_positives = fp, .false_negatives = fn, .true_negatives = tn};
}

TEST(BinaryScoreTest, CountsEachOfTheFourOutcomes) {
  BinaryScore score;
  for (const auto& [predicted, actual] :
       {std::pair{true, true}, {true, true}, {true, false}, {false, true}, {false, false}}) {
    score.Add(predicted, actual);
  }
  EXPECT_EQ(score.true_positives, 2);
  EXPECT_EQ(score.false_positives, 1);
  EXPECT_EQ(score.false_negatives, 1);
  EXPECT_EQ(score.true_negatives, 1);
  EXPECT_EQ(score.total(), 5);
  score += score;
  EXPECT_EQ(score.true_positives, 4);
  EXPECT_EQ(score.total(), 10);
}

TEST(BinaryScoreTest, SharesOfKnownCounts) {
  const BinaryScore score = Score(6, 2, 4, 8);
  EXPECT_DOUBLE_EQ(*score.Precision(), 0.75);
  EXPECT_DOUBLE_EQ(*score.Recall(), 0.6);
  EXPECT_DOUBLE_EQ(*score.F1(), 2 * 0.75 * 0.6 / (0.75 + 0.6));
  EXPECT_DOUBLE_EQ(*score.FalsePositiveRate(), 0.2);
}

TEST(BinaryScoreTest, SharesOfNothingAreAbsent) {
  const BinaryScore nothing = Score(0, 0, 0, 5);
  EXPECT_EQ(nothing.Precision(), std::nullopt);
  EXPECT_EQ(nothing.Recall(), std::nullopt);
  EXPECT_EQ(nothing.F1(), std::nullopt);
  EXPECT_EQ(Score(3, 0, 2, 0).FalsePositiveRate(), std::nullopt);
  EXPECT_DOUBLE_EQ(*Score(0, 0, 2, 0).F1(), 0);
}

}  // namespace
}  // namespace mapp
