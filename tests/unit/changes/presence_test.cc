#include "server/changes/presence.h"

#include <gtest/gtest.h>

#include <cmath>
#include <vector>

namespace mapp {
namespace {

constexpr int64_t kHourNs = int64_t{3600} * 1'000'000'000;

/// One visit an hour; positive: so much was seen, negative: missed.
PresencePosterior Infer(const std::vector<double>& visits, const PresenceOptions& options = {}) {
  std::vector<PresenceEvidence> evidence;
  for (size_t i = 0; i < visits.size(); ++i) {
    evidence.push_back({static_cast<int64_t>(i) * kHourNs, std::max(0.0, visits[i]), std::max(0.0, -visits[i])});
  }
  return InferPresence(evidence, options);
}

TEST(PresenceTest, WhatIsSeenIsThere) {
  const PresencePosterior posterior = Infer({20, 20, 20});
  for (const double present : posterior.present) EXPECT_GT(present, 0.99);
  for (const double vanished : posterior.vanished) EXPECT_LT(vanished, 0.01);
}

TEST(PresenceTest, OneClearVisitTellsThatItHasGone) {
  const PresencePosterior posterior = Infer({20, 20, 20, -20});
  EXPECT_TRUE(posterior.likely[2]);
  EXPECT_FALSE(posterior.likely[3]);
  EXPECT_GT(posterior.vanished[2], 0.8);
}

TEST(PresenceTest, OneWeakVisitDoesNot) {
  const PresencePosterior posterior = Infer({20, 20, 20, -1});
  EXPECT_TRUE(posterior.likely[3]);
  EXPECT_LT(posterior.vanished[2], 0.5);
}

TEST(PresenceTest, MoreVisitsMakeSurer) {
  const double one = Infer({20, 20, -8}).vanished[1];
  const double two = Infer({20, 20, -8, -8}).vanished[1];
  EXPECT_GT(two, one);
}

TEST(PresenceTest, ThingsComeBack) {
  const PresencePosterior posterior = Infer({20, 20, -20, -20, 20, 20});
  EXPECT_EQ(posterior.likely, (std::vector<bool>{true, true, false, false, true, true}));
  EXPECT_GT(posterior.vanished[1], 0.8);
  EXPECT_GT(posterior.appeared[3], 0.8);
}

TEST(PresenceTest, HalfSeenSaysLittle) {
  const PresenceOptions options;
  const double half = PresenceLogRatio({0, 10, 10}, options);
  const double all = PresenceLogRatio({0, 20, 0}, options);
  EXPECT_LT(std::abs(half), 0.25 * all);
  EXPECT_EQ(PresenceLogRatio({0, 0, 0}, options), 0);
}

TEST(PresenceTest, ProbabilitiesSumUpWithTheStates) {
  const PresencePosterior posterior = Infer({5, -3, 2, -10, -10, 4});
  for (size_t i = 0; i + 1 < posterior.present.size(); ++i) {
    // P(there) changes by what comes and goes.
    EXPECT_NEAR(posterior.present[i + 1] - posterior.present[i], posterior.appeared[i] - posterior.vanished[i], 1e-9);
  }
}

TEST(PresenceTest, NoVisitsNoPosterior) { EXPECT_TRUE(Infer({}).present.empty()); }

}  // namespace
}  // namespace mapp
