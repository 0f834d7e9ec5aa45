#include "cli/interrupt.h"

#include <gtest/gtest.h>

#include <csignal>
#include <latch>
#include <thread>
#include <unistd.h>

namespace mapp {
namespace {

class InterruptTest : public ::testing::TestWithParam<int> {
 protected:
  // Some tests fork; libraries have threads.
  InterruptTest() { GTEST_FLAG_SET(death_test_style, "threadsafe"); }
};
INSTANTIATE_TEST_SUITE_P(Signals, InterruptTest, ::testing::Values(SIGINT, SIGTERM));

TEST_P(InterruptTest, IsAStopRequestWhicheverThreadGetsTheSignal) {
  const auto watcher = InterruptWatcher::Create();
  ASSERT_TRUE(watcher.ok()) << watcher.status();
  const std::stop_token token = (*watcher)->token();
  EXPECT_FALSE(token.stop_requested());
  std::jthread([] { raise(GetParam()); }).join();
  while (!token.stop_requested()) std::this_thread::yield();
}

TEST_P(InterruptTest, ThreadsThatWereThereBeforeDoNotEndTheProcess) {
  std::latch done(1);
  std::jthread before([&done] { done.wait(); });
  {
    const auto watcher = InterruptWatcher::Create();
    ASSERT_TRUE(watcher.ok()) << watcher.status();
    pthread_kill(before.native_handle(), GetParam());
    while (!(*watcher)->token().stop_requested()) std::this_thread::yield();
  }
  done.count_down();
}

TEST_P(InterruptTest, SecondSignalEndsTheProcess) {
  const auto signal_twice = [] {
    const auto watcher = InterruptWatcher::Create();
    raise(GetParam());
    while (!(*watcher)->token().stop_requested()) std::this_thread::yield();
    raise(GetParam());
    for (;;) pause();
  };
  EXPECT_EXIT(signal_twice(), ::testing::ExitedWithCode(130), "");
}

TEST_P(InterruptTest, SignalsAreThemselvesAgainAfterwards) {
  ASSERT_TRUE(InterruptWatcher::Create().ok());
  EXPECT_EXIT(raise(GetParam()), ::testing::KilledBySignal(GetParam()), "");
}

}  // namespace
}  // namespace mapp
