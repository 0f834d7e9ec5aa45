#include "mapp/base/latency.h"

#include "mapp/base/process_usage.h"

#include <gtest/gtest.h>

namespace mapp {
namespace {

using std::chrono::milliseconds;

TEST(LatencyRecorderTest, SummarizesByMeanAndNearestRank) {
  LatencyRecorder recorder;
  for (int ms = 100; ms >= 1; --ms) recorder.Add(milliseconds(ms));
  const LatencySummary summary = recorder.Summary();
  EXPECT_EQ(summary.count, 100U);
  EXPECT_DOUBLE_EQ(summary.mean_ms, 50.5);
  EXPECT_DOUBLE_EQ(summary.p50_ms, 50);
  EXPECT_DOUBLE_EQ(summary.p95_ms, 95);
  EXPECT_DOUBLE_EQ(summary.total_ms(), 5050);
}

TEST(LatencyRecorderTest, IsAllZeroWithoutRuns) {
  const LatencySummary summary = LatencyRecorder().Summary();
  EXPECT_EQ(summary.count, 0U);
  EXPECT_EQ(summary.mean_ms, 0);
  EXPECT_EQ(summary.p95_ms, 0);
}

TEST(LatencyRecorderTest, PercentilesForgetWhatIsOlderThanTheWindow) {
  LatencyRecorder recorder;
  for (size_t i = 0; i < LatencyRecorder::kWindow; ++i) recorder.Add(milliseconds(1000));
  for (size_t i = 0; i < LatencyRecorder::kWindow; ++i) recorder.Add(milliseconds(2));
  const LatencySummary summary = recorder.Summary();
  EXPECT_EQ(summary.count, 2 * LatencyRecorder::kWindow);
  EXPECT_DOUBLE_EQ(summary.mean_ms, 501);
  EXPECT_DOUBLE_EQ(summary.p95_ms, 2);
}

TEST(LatencyRecorderTest, AddsAnothersRunsAsIfTheyHadComeAfterItsOwn) {
  LatencyRecorder first, second, together;
  const auto add = [&](LatencyRecorder& recorder, int ms) {
    recorder.Add(milliseconds(ms));
    together.Add(milliseconds(ms));
  };
  for (size_t i = 0; i < LatencyRecorder::kWindow; ++i) add(first, 1000);
  for (size_t i = 0; i < LatencyRecorder::kWindow + 7; ++i) add(second, static_cast<int>(i % 50));
  first.Add(second);
  first.Add(LatencyRecorder());
  first.Add(milliseconds(3));
  together.Add(milliseconds(3));
  const LatencySummary summed = first.Summary(), expected = together.Summary();
  EXPECT_EQ(summed.count, expected.count);
  EXPECT_DOUBLE_EQ(summed.mean_ms, expected.mean_ms);
  EXPECT_DOUBLE_EQ(summed.p50_ms, expected.p50_ms);
  EXPECT_DOUBLE_EQ(summed.p95_ms, expected.p95_ms);
}

TEST(ProcessUsageTest, GrowsWithWorkAndMemory) {
  const ProcessUsage before = GetProcessUsage();
  const double thread_before_s = ThreadCpuSeconds();
  std::vector<char> memory(size_t{64} << 20, 1);
  volatile uint64_t sum = 0;
  while (ThreadCpuSeconds() < thread_before_s + 0.02) {
    for (const char byte : memory) sum = sum + static_cast<uint64_t>(byte);
  }
  const ProcessUsage after = GetProcessUsage();
  EXPECT_GE(after.cpu_s - before.cpu_s, 0.015);
  EXPECT_GE(after.rss_bytes, before.rss_bytes + (size_t{60} << 20));
  EXPECT_GE(after.peak_rss_bytes, after.rss_bytes - (size_t{1} << 20));
}

}  // namespace
}  // namespace mapp
