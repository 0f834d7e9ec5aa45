#include "client_sdk/src/tracker/restart_policy.h"

#include <gtest/gtest.h>

namespace mapp::tracker {
namespace {

constexpr int64_t kFrameNs = 100'000'000;
constexpr int kManyKeyframes = 50;

class RestartPolicyTest : public ::testing::Test {
 protected:
  RestartPolicyTest() {
    options_.max_search_s = 3;
    options_.max_young_search_s = 1;
    options_.num_young_keyframes = 10;
  }

  /// The next frame, `step_ns` after the last.
  bool Lost(bool can_start = true, int num_keyframes = kManyKeyframes, int64_t step_ns = kFrameNs) {
    return Tell({.lost = true, .can_start = can_start, .num_keyframes = num_keyframes}, step_ns);
  }
  bool Tracked() { return Tell({.lost = false, .can_start = false, .num_keyframes = kManyKeyframes}, kFrameNs); }
  /// Frames lost until the restart is due, at most 1000.
  int CountUntilDue(int num_keyframes, int64_t step_ns = kFrameNs) {
    for (int count = 1; count <= 1000; ++count) {
      if (Lost(true, num_keyframes, step_ns)) return count;
    }
    return -1;
  }

  OrbTrackerOptions options_;

 private:
  bool Tell(RestartPolicy::Outcome outcome, int64_t step_ns) {
    if (!policy_) policy_.emplace(options_);
    stamp_ns_ += step_ns;
    outcome.stamp_ns = stamp_ns_;
    return policy_->IsDue(outcome);
  }
  std::optional<RestartPolicy> policy_;
  int64_t stamp_ns_ = 0;
};

TEST_F(RestartPolicyTest, IsDueAfterTheTimeOfSearchThatTheMapIsWorth) {
  Tracked();
  EXPECT_EQ(CountUntilDue(kManyKeyframes), 30);
}

TEST_F(RestartPolicyTest, SearchesAYoungMapForAShorterTime) {
  Tracked();
  EXPECT_EQ(CountUntilDue(9), 10);
  Tracked();
  EXPECT_EQ(CountUntilDue(10), 30);
}

TEST_F(RestartPolicyTest, AFrameThatIsTrackedEndsTheSearch) {
  Tracked();
  for (int i = 0; i < 29; ++i) ASSERT_FALSE(Lost());
  Tracked();
  EXPECT_EQ(CountUntilDue(kManyKeyframes), 30);
}

TEST_F(RestartPolicyTest, FramesThatShowNothingDoNotCount) {
  Tracked();
  for (int i = 0; i < 500; ++i) ASSERT_FALSE(Lost(/*can_start=*/false));
  EXPECT_EQ(CountUntilDue(kManyKeyframes), 30);
}

TEST_F(RestartPolicyTest, AGapBetweenFramesIsNotTimeSearched) {
  Tracked();
  // Six frames at half a second each, however far apart they are.
  EXPECT_EQ(CountUntilDue(kManyKeyframes, 60'000'000'000), 6);
}

TEST_F(RestartPolicyTest, NeverRestartsWhenSwitchedOff) {
  options_.max_search_s = 0;
  Tracked();
  EXPECT_EQ(CountUntilDue(1), -1);
}

}  // namespace
}  // namespace mapp::tracker
