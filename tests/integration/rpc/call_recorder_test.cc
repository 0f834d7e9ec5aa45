#include "server/rpc/call_recorder.h"

#include "server/rpc/prometheus_exporter.h"

#include <gtest/gtest.h>

namespace mapp {
namespace {

using std::chrono::milliseconds;

TEST(CallRecorderTest, CountsCallsErrorsAndTimeByMethod) {
  CallRecorder recorder(nullptr);
  for (int i = 1; i <= 100; ++i) recorder.Record("Assess", i <= 10 ? "INTERNAL" : "OK", milliseconds(i), 10);
  recorder.Record("Upload", "OK", milliseconds(7), 10);
  const std::vector<MethodFigures> figures = recorder.Snapshot();
  ASSERT_EQ(figures.size(), 2U);
  EXPECT_EQ(figures[0].method, "Assess");
  EXPECT_EQ(figures[0].num_errors, 10U);
  EXPECT_EQ(figures[0].latency.count, 100U);
  EXPECT_DOUBLE_EQ(figures[0].latency.mean_ms, 50.5);
  EXPECT_DOUBLE_EQ(figures[0].latency.p95_ms, 95);
  EXPECT_EQ(figures[1].latency.count, 1U);
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
