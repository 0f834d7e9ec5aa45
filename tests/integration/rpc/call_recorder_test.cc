#include "server/rpc/call_recorder.h"

#include "server/rpc/prometheus_exporter.h"

#include <gtest/gtest.h>

namespace mapp {
namespace {

using std::chrono::milliseconds;

TEST(CallRecorderTest, MedianAndP95AreOfTheLatestCalls) {
  CallRecorder recorder(nullptr);
  for (int i = 1; i <= 100; ++i) recorder.Record("Assess", "OK", milliseconds(i), 10);
  const std::vector<MethodFigures> figures = recorder.Snapshot();
  ASSERT_EQ(figures.size(), 1U);
  EXPECT_EQ(figures[0].num_calls, 100U);
  EXPECT_FLOAT_EQ(static_cast<float>(figures[0].median_ms), 50);
  EXPECT_FLOAT_EQ(static_cast<float>(figures[0].p95_ms), 95);
}

TEST(CallRecorderTest, OldCallsLeaveTheWindowButNotTheCount) {
  CallRecorder recorder(nullptr);
  for (size_t i = 0; i < 100; ++i) recorder.Record("Assess", "INTERNAL", milliseconds(1000), 10);
  for (size_t i = 0; i < CallRecorder::kWindow; ++i) recorder.Record("Assess", "OK", milliseconds(2), 10);
  const std::vector<MethodFigures> figures = recorder.Snapshot();
  EXPECT_EQ(figures[0].num_calls, 100U + CallRecorder::kWindow);
  EXPECT_EQ(figures[0].num_errors, 100U);
  EXPECT_FLOAT_EQ(static_cast<float>(figures[0].p95_ms), 2);
}

TEST(CallRecorderTest, ACallerThatLeavesIsNoError) {
  CallRecorder recorder(nullptr);
  recorder.Record("WatchSession", "CANCELLED", milliseconds(1), 0);
  EXPECT_EQ(recorder.Snapshot()[0].num_errors, 0U);
}

TEST(PrometheusExporterTest, AnAddressThatCannotBeServedIsNamed) {
  const auto exporter = PrometheusExporter::Listen("256.0.0.1:1");
  ASSERT_FALSE(exporter.ok());
  EXPECT_NE(exporter.status().ToString().find("256.0.0.1:1"), std::string::npos);
}

}  // namespace
}  // namespace mapp
