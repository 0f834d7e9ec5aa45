#include "eval/metrics/overlap_metrics.h"

#include <gtest/gtest.h>

#include <cmath>

namespace mapp {
namespace {

/// `count` points of which the first `num_true` have it.
std::vector<bool> First(size_t count, size_t num_true) {
  std::vector<bool> flags(count);
  for (size_t i = 0; i < num_true; ++i) flags[i] = true;
  return flags;
}

/// A view that is judged as the oracle has it.
JudgedView Faithful(size_t count, size_t num_known) {
  const std::vector<bool> known = First(count, num_known);
  return {known, known, KnownShare(known).value_or(0)};
}

std::vector<JudgedView> FaithfulViews() {
  return {Faithful(100, 95), Faithful(100, 40), Faithful(50, 50), Faithful(80, 0)};
}

TEST(OverlapScoreTest, FaithfulAnswersAreFlawless) {
  const auto score = ScoreOverlap(FaithfulViews());
  ASSERT_TRUE(score.ok()) << score.status();
  EXPECT_EQ(score->num_views, 4);
  EXPECT_DOUBLE_EQ(*score->seen.F1(), 1);
  EXPECT_DOUBLE_EQ(*score->Lost(), 0);
  EXPECT_DOUBLE_EQ(*score->Resent(), 0);
  EXPECT_DOUBLE_EQ(*score->points.Precision(), 1);
  EXPECT_DOUBLE_EQ(score->bias, 0);
  EXPECT_DOUBLE_EQ(score->rmse, 0);
  EXPECT_DOUBLE_EQ(score->mean_true_overlap, (0.95 + 0.4 + 1 + 0) / 4);
}

TEST(OverlapScoreTest, InvertedAnswersLoseAndResendEverything) {
  std::vector<JudgedView> views = FaithfulViews();
  for (JudgedView& view : views) {
    view.redundant.flip();
    view.overlap = 1 - view.overlap;
  }
  const auto score = ScoreOverlap(views);
  ASSERT_TRUE(score.ok()) << score.status();
  EXPECT_DOUBLE_EQ(*score->Lost(), 1);
  EXPECT_DOUBLE_EQ(*score->Resent(), 1);
  EXPECT_DOUBLE_EQ(*score->points.Precision(), 0);
  EXPECT_DOUBLE_EQ(*score->seen.F1(), 0);
  EXPECT_NEAR(score->bias, (-0.9 + 0.2 - 1 + 1) / 4, 1e-12);
  EXPECT_NEAR(score->rmse, std::sqrt((0.81 + 0.04 + 1 + 1) / 4), 1e-12);
}

TEST(OverlapScoreTest, CallingEverythingKnownLosesAllThatIsFresh) {
  std::vector<JudgedView> views = FaithfulViews();
  for (JudgedView& view : views) {
    view.redundant.assign(view.known.size(), true);
    view.overlap = 1;
  }
  const auto score = ScoreOverlap(views);
  ASSERT_TRUE(score.ok()) << score.status();
  EXPECT_DOUBLE_EQ(*score->Lost(), 1);
  EXPECT_DOUBLE_EQ(*score->Resent(), 0);
  EXPECT_DOUBLE_EQ(*score->points.Precision(), 185.0 / 330);
  EXPECT_DOUBLE_EQ(*score->points.Recall(), 1);
  EXPECT_DOUBLE_EQ(*score->seen.Precision(), 0.5);
  EXPECT_DOUBLE_EQ(*score->seen.Recall(), 1);
  EXPECT_DOUBLE_EQ(*score->seen.F1(), 2.0 / 3);
}

TEST(OverlapScoreTest, EachWrongPointCountsOnce) {
  JudgedView view = Faithful(100, 60);
  for (size_t i = 0; i < 6; ++i) view.redundant[i] = false;   // a tenth of the known is sent again
  for (size_t i = 60; i < 70; ++i) view.redundant[i] = true;  // a quarter of the fresh is dropped
  view.overlap = 0.64;
  const auto score = ScoreOverlap(std::vector<JudgedView>{view});
  ASSERT_TRUE(score.ok()) << score.status();
  EXPECT_DOUBLE_EQ(*score->Lost(), 0.25);
  EXPECT_DOUBLE_EQ(*score->Resent(), 0.1);
  EXPECT_DOUBLE_EQ(*score->points.Precision(), 54.0 / 64);
  EXPECT_DOUBLE_EQ(*score->points.Recall(), 0.9);
  EXPECT_NEAR(score->bias, 0.04, 1e-12);
}

TEST(OverlapScoreTest, SeenIsDecidedAtTheThreshold) {
  std::vector<JudgedView> views = {Faithful(10, 9), Faithful(10, 8), Faithful(10, 10)};
  views[1].overlap = 0.9;                     // wrongly seen
  views[2].overlap = std::nextafter(0.9, 0);  // missed by a hair
  const auto score = ScoreOverlap(views);
  ASSERT_TRUE(score.ok()) << score.status();
  EXPECT_EQ(score->seen.true_positives, 1);
  EXPECT_EQ(score->seen.false_positives, 1);
  EXPECT_EQ(score->seen.false_negatives, 1);
  EXPECT_EQ(ScoreOverlap(views, 0.5)->seen.true_positives, 3);
}

TEST(OverlapScoreTest, ViewsWithoutPointsDoNotCount) {
  const auto score = ScoreOverlap(std::vector<JudgedView>{{{}, {}, 0.0}, Faithful(10, 3)});
  ASSERT_TRUE(score.ok()) << score.status();
  EXPECT_EQ(score->num_views, 1);
  EXPECT_DOUBLE_EQ(score->bias, 0);
  const auto nothing = ScoreOverlap({});
  ASSERT_TRUE(nothing.ok()) << nothing.status();
  EXPECT_EQ(nothing->Lost(), std::nullopt);
}

TEST(OverlapScoreTest, RefusesWhatCannotBeCompared) {
  EXPECT_EQ(ScoreOverlap(std::vector<JudgedView>{{First(3, 1), First(4, 1), 0.3}}).status().code(),
            absl::StatusCode::kInvalidArgument);
  for (const double overlap : {-0.1, 1.1, std::nan("")}) {
    EXPECT_FALSE(ScoreOverlap(std::vector<JudgedView>{{First(3, 1), First(3, 1), overlap}}).ok());
  }
}

}  // namespace
}  // namespace mapp
